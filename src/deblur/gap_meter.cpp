#include "src/deblur/gap_meter.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "src/core/crew.hpp"
#include "src/deblur/grid.hpp"
#include "src/deblur/noise_meter.hpp"

namespace bolo::deblur {
namespace {

using motion::Affine;
using motion::PaddedPlane;

constexpr int kWindow = 32;               // px a side of a window with one error of the motion
constexpr int kFirst = 4;                 // frames before the first of a pair, for its instrument and its blur
constexpr int kApart = 4;                 // frames of a pair at least: so they share no noise, nor do their instruments
constexpr std::size_t kPairs = 8;         // of the hundreds in a burst
constexpr double kFarthest = 40.0;        // px that the picture may move between a pair's frames
constexpr double kOfHeight = 0.3;         // or this share of the picture's height, vertically
constexpr int kBorder = 6;                // px whose smoothed values include more than the picture
constexpr double kLeastChange = 0.3;      // px^2, of a pair: errors of the motion are a tenth of it
constexpr double kMostUncertain = 0.011;  // of tau; fast motion determines it poorly, and with a bias
constexpr double kMostUnexplained = 0.05;  // of the two frames' difference: above it the motion was not found
constexpr int kWeighings = 3;              // iterations of the windows' weights

// Variance of the age of an innovation's content, whose age is at most one period.
double own_variance(const motion::Inertia& inertia) {
  const double tau = inertia.tau;
  const double square = 2.0 * tau * tau - (1.0 + 2.0 * tau) * inertia.rho * inertia.gain();
  return square - inertia.age() * inertia.age();
}

double polynomial(const std::array<double, 3>& by_powers, double rho) {
  return by_powers[0] + rho * (by_powers[1] + rho * by_powers[2]);
}

}  // namespace

double GapFigures::ratio_with(double times) const {
  const double rho = std::exp(-1.0 / (times * tau_periods));
  return std::sqrt(std::max(0.0, polynomial(square, rho)));
}

GapMeter::GapMeter(const StreamFormat& format, double tau_s)
    : task_{.settings = {}, .input = format},
      tau_s_(tau_s),
      kernels_(motion::best_kernels()),
      global_(format.geometry),
      work_{PaddedPlane(format.geometry), PaddedPlane(format.geometry), PaddedPlane(format.geometry)},
      a_(format.geometry),
      b_(format.geometry),
      q_(format.geometry),
      z_(format.geometry),
      pyramids_{motion::Pyramid(format.geometry), motion::Pyramid(format.geometry)},
      field_(motion::blocks_over(format.geometry.width), motion::blocks_over(format.geometry.height)) {}

void GapMeter::load(int frame, PaddedPlane& to) const {
  for (int y = 0; y < task_.input.geometry.height; ++y) {
    task_.load_row(planes_[static_cast<std::size_t>(frame)], y, to.at(0, y));
  }
  to.extend();
}

void GapMeter::innovate(int frame, motion::Pyramid& to) {
  Alone alone;
  load(frame, work_[0]);
  load(frame - 1, work_[1]);
  motion::find_innovation(kernels_, inertia_, work_[0], work_[1], alone, work_[2], to);
}

void GapMeter::follow() {
  Alone alone;
  innovate(1, pyramids_[1]);
  for (std::size_t k = 2; k < moved_.size(); ++k) {
    innovate(static_cast<int>(k), pyramids_[k % 2]);
    moved_[k] = global_.find(kernels_, inertia_, pyramids_[(k + 1) % 2], pyramids_[k % 2], noise_, alone);
  }
  moved_[1] = moved_[2];
}

std::vector<GapMeter::Pair> GapMeter::choose() const {
  std::array<Affine, kFrames> place;
  std::array<Affine, kFrames> blur;  // the velocity that blurred a frame
  blur[1] = moved_[1];
  for (std::size_t k = 2; k < moved_.size(); ++k) {
    place[k] = place[k - 1] + moved_[k];
    blur[k] = blur[k - 1] * inertia_.rho + moved_[k] * (1.0 - inertia_.rho);
  }
  const double lowest = std::min(kFarthest, kOfHeight * task_.input.geometry.height);
  std::vector<Pair> pairs;
  for (std::size_t k = kFirst + kApart; k < moved_.size(); ++k) {
    for (std::size_t j = kFirst; j + kApart <= k; ++j) {
      const Affine way = place[k] + place[j] * -1.0;
      const auto product = [&](std::size_t u, std::size_t v) {
        return blur[k].p[u] * blur[k].p[v] - blur[j].p[u] * blur[j].p[v];
      };
      const double change = std::hypot(product(0, 0), std::sqrt(2.0) * product(0, 3), product(3, 3));
      if (std::abs(way.p[0]) > kFarthest || std::abs(way.p[3]) > lowest || change < kLeastChange) continue;
      pairs.push_back({static_cast<int>(j), static_cast<int>(k), change});
    }
  }
  std::ranges::sort(pairs, std::greater(), &Pair::change);
  std::vector<Pair> chosen;
  for (const Pair& p : pairs) {
    const auto alike = [&p](const Pair& o) { return std::abs(o.late - p.late) < 2 && std::abs(o.early - p.early) < 2; };
    if (chosen.size() < kPairs && std::ranges::none_of(chosen, alike)) chosen.push_back(p);
  }
  return chosen;
}

// to += share * the frame, smoothed and moved by `by`.
void GapMeter::add(int frame, const Affine& by, float share, PaddedPlane& to) {
  const Geometry g = task_.input.geometry;
  load(frame, work_[0]);
  kernels_.smooth(work_[0], 0, g.height, work_[1]);
  work_[1].extend();
  motion::spread(by, g, 1, field_);
  for (int row = 0; row < field_.down(); ++row) kernels_.shift(work_[1], field_.row(row), row, work_[2]);
  for (int y = 0; y < g.height; ++y) {
    const float* from = work_[2].at(0, y);
    float* out = to.at(0, y);
    for (int x = 0; x < g.width; ++x) out[x] += share * from[x];
  }
}

void GapMeter::compare(const Pair& pair) {
  Alone alone;
  innovate(pair.early, pyramids_[0]);
  innovate(pair.late, pyramids_[1]);
  const Affine way = global_.find(kernels_, inertia_, pyramids_[0], pyramids_[1], noise_, alone);
  const auto last_two = [&](int k) {
    return moved_[static_cast<std::size_t>(k)] + moved_[static_cast<std::size_t>(k - 1)];
  };
  for (PaddedPlane* plane : {&a_, &b_, &q_, &z_}) plane->fill(0.0F);
  const auto add_change = [&](int back, const Affine& late, const Affine& early, float share, PaddedPlane& to) {
    add(pair.late - back, late, share, to);
    add(pair.early - back, early, -share, to);
  };
  const Affine late = last_two(pair.late);
  const Affine early = way + last_two(pair.early);
  add_change(0, {}, way, 1.0F, a_);
  add_change(1, {}, way, 1.0F, b_);
  add_change(2, late, early, 1.0F, q_);
  add_change(3, late, early, -1.0F, q_);
  add(pair.late, {}, 1.0F, z_);
  add(pair.late - 1, {}, -static_cast<float>(inertia_.rho), z_);
  take_own_blur(pair);
  const Geometry g = task_.input.geometry;
  const auto from = [&](std::size_t axis) {
    return kBorder + static_cast<int>(std::ceil(std::max({0.0, way.p[axis], early.p[axis], late.p[axis]})));
  };
  const auto until = [&](std::size_t axis, int size) {
    return size - kBorder + static_cast<int>(std::floor(std::min({0.0, way.p[axis], early.p[axis], late.p[axis]})));
  };
  std::size_t window = 0;
  for (int y = 0; y < g.height; y += kWindow) {
    for (int x = 0; x < g.width; x += kWindow, ++window) {
      const int left = std::max(x, from(0));
      const int top = std::max(y, from(3));
      const Region part{left, top, std::min(x + kWindow, until(0, g.width)) - left,
                        std::min(y + kWindow, until(3, g.height)) - top};
      if (part.width > kWindow / 4 && part.height > kWindow / 4) sum_up(part, window);
    }
  }
}

// Subtracts from a the effect of motion within the two frames: half the difference of their trails' variances, times
// the second derivatives of (1 - rho) x, which is z.
void GapMeter::take_own_blur(const Pair& pair) {
  const double own = own_variance(inertia_);
  const auto velocity = [&](int k, std::size_t axis) {  // in the middle of frame k, which its innovation shows
    const std::size_t next = std::min(static_cast<std::size_t>(k) + 1, moved_.size() - 1);
    return 0.5 * (moved_[static_cast<std::size_t>(k)].p[axis] + moved_[next].p[axis]);
  };
  const auto change = [&](std::size_t u, std::size_t v) {
    return static_cast<float>(
        0.5 * own *
        (velocity(pair.late, u) * velocity(pair.late, v) - velocity(pair.early, u) * velocity(pair.early, v)));
  };
  const float across = change(0, 0);
  const float both = 0.5F * change(0, 3);
  const float down = change(3, 3);
  const Geometry g = task_.input.geometry;
  for (int y = 1; y < g.height - 1; ++y) {
    const float* up = z_.at(0, y - 1);
    const float* z = z_.at(0, y);
    const float* low = z_.at(0, y + 1);
    float* a = a_.at(0, y);
    for (int x = 1; x < g.width - 1; ++x) {
      a[x] -= across * (z[x + 1] - 2.0F * z[x] + z[x - 1]) + down * (low[x] - 2.0F * z[x] + up[x]) +
              both * (low[x + 1] - low[x - 1] - up[x + 1] + up[x - 1]);
    }
  }
}

void GapMeter::sum_up(const Region& part, std::size_t window) {
  enum { kAcross, kDown, kMean, kQ, kA, kB, kTerms };
  std::array<std::array<double, kTerms>, kTerms> s{};
  for (int y = part.y; y < part.y + part.height; ++y) {
    for (int x = part.x; x < part.x + part.width; ++x) {
      const std::array<float, kTerms> v{0.5F * (*z_.at(x + 1, y) - *z_.at(x - 1, y)),
                                        0.5F * (*z_.at(x, y + 1) - *z_.at(x, y - 1)),
                                        1.0F,
                                        *q_.at(x, y),
                                        *a_.at(x, y),
                                        *b_.at(x, y)};
      for (std::size_t i = 0; i < kTerms; ++i) {
        for (std::size_t j = i; j < kTerms; ++j) s[i][j] += static_cast<double>(v[i] * v[j]);
      }
    }
  }
  const double count = s[kMean][kMean];
  for (std::size_t p = 0; p <= kMean; ++p) {  // projects the first three out of the others
    const double pivot = s[p][p] + 1e-9 * count;
    for (std::size_t i = p + 1; i < kTerms; ++i) {
      for (std::size_t j = i; j < kTerms; ++j) s[i][j] -= s[p][i] * s[p][j] / pivot;
    }
  }
  samples_.push_back({window, count, s[kQ][kA], s[kQ][kB], s[kA][kA], s[kA][kB], s[kB][kB]});
}

// Windows with large residuals, of any cause, get little weight. The standard error is clustered by window.
void GapMeter::regress(GapFigures& figures) {
  const double given = inertia_.rho;
  const double floor = 2.0 * (1.0 + given * given) * motion::kSmoothedNoise * noise_ * noise_;
  double rho = given;
  double power = 0.0;
  std::vector<double> errors(field_.size());  // a window is larger than a block
  const auto weight = [&](const Sample& s) { return 1.0 / (1.0 + std::max(s.left(rho), 0.0) / floor); };
  for (int step = 0; step < kWeighings; ++step) {
    double product = 0.0;
    power = 0.0;
    for (const Sample& s : samples_) {
      product += weight(s) * s.qa;
      power += weight(s) * s.qb;
    }
    const double next = product / power;
    if (!(next > 0.0 && next < 1.0)) return;
    rho = next;
  }
  std::array<double, 3> left{};  // by powers of rho
  double weights = 0.0;
  for (const Sample& s : samples_) {
    const double w = weight(s);
    errors[s.window] += w * (s.qa - rho * s.qb);
    left[0] += w * s.aa;
    left[1] -= w * 2.0 * s.ab;
    left[2] += w * s.bb;
    weights += w * s.count;
  }
  const double least = polynomial(left, rho);
  double square = 0.0;
  for (const double e : errors) square += e * e;
  const double tau = -1.0 / std::log(rho);
  const double sigma = std::sqrt(square) / std::abs(power) * tau * tau / rho / inertia_.tau;
  if (least - floor * weights > kMostUnexplained * left[0] || !(sigma < kMostUncertain)) return;
  for (std::size_t i = 0; i < left.size(); ++i) figures.square[i] = left[i] / weights / floor;
  figures.tau_periods = inertia_.tau;
  figures.ratio = figures.ratio_with(1.0);
  figures.tau_ratio = tau / inertia_.tau;
  figures.tau_sigma = sigma;
}

GapFigures GapMeter::measure(std::span<const void* const> planes, double period_s) {
  planes_ = planes;
  inertia_ = motion::Inertia(tau_s_ / period_s);
  NoiseMeter meter(task_);
  Pattern pattern;
  pattern.slots = kFrames;
  std::fill_n(pattern.received.begin(), kFrames, true);
  Alone alone;
  meter.update({planes, kFrames - 1, 0}, pattern, alone);
  noise_ = meter.noise();
  GapFigures figures{.noise_k = task_.in_kelvin(noise_)};
  const Geometry g = task_.input.geometry;
  if (std::min(g.width, g.height) < motion::kLeastSide) return figures;
  follow();
  for (const Affine& m : moved_) figures.speed = std::max(figures.speed, std::hypot(m.p[0], m.p[3]));
  samples_.clear();
  for (const Pair& pair : choose()) compare(pair);
  if (!samples_.empty()) regress(figures);
  return figures;
}

}  // namespace bolo::deblur
