#include "src/diagnose/field_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>

#include <Eigen/Core>

#include "src/capture/capture.hpp"
#include "src/core/statistics.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::diagnose {
namespace {

constexpr int kStretch = 24;  // frames, in which the picture has one spectrum
constexpr std::size_t kMostFrames = 4000;
constexpr int kAcross = 40;     // periods in the picture's width, up to which frequencies are looked at
constexpr int kAcrossStep = 2;  // between them: Hann's window blurs neighbours into one another
constexpr int kDown = 10;
constexpr int kSubsteps = 4;          // of a frame period, along the path
constexpr double kMemory = 7.0;       // time constants that a pixel remembers
constexpr double kClearPower = 10.0;  // over the noise, of a frequency in a frame
constexpr double kTauStep = 0.06;     // of the logarithm of the time constants that are tried
constexpr int kTaus = 17;
constexpr int kNominal = kTaus / 2;       // of the profile, among them
constexpr double kMostDeviation = 1.5;    // of a logarithm: more says that another scene is seen
constexpr double kWidestInterval = 0.1;   // half of it, of the value: a wider one tells nothing
constexpr double kMostDelayError = 3e-6;  // s, half of a row delay's interval: the same
constexpr int kFewestStretches = 8;
constexpr int kLeftOut = 16;            // of the jackknife
constexpr double kOutlyingShear = 6.0;  // standard deviations of a shear

using Wave = std::complex<float>;
using WaveMatrix = Eigen::Matrix<Wave, Eigen::Dynamic, Eigen::Dynamic>;

struct Frequency {
  int across;
  int down;
};

// Half of the plane, without what a slope of the whole picture shows, and without the neighbours of the axes: upright
// and level lines are so strong there that what leaks of them hides what is blurred the other way.
std::vector<Frequency> frequencies() {
  const auto clear = [](int periods) { return periods == 0 || periods > 3; };
  std::vector<Frequency> all;
  for (int down = 0; down <= kDown; ++down) {
    for (int across = -kAcross; across <= kAcross; across += kAcrossStep) {
      const bool half = down > 0 || across > 0;
      if (half && clear(std::abs(across)) && clear(down) && (across != 0 || down != 0)) all.push_back({across, down});
    }
  }
  return all;
}

float hann(int i, int n) { return static_cast<float>(0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (i + 0.5) / n)); }

// The power of a frame at the frequencies, under Hann's window.
class FrameSpectrum {
 public:
  FrameSpectrum(Geometry geometry, std::vector<Frequency> at) : at_(std::move(at)) {
    across_ = waves(geometry.width, kAcross);
    down_ = waves(geometry.height, kDown);
    const auto squared = [](int n) { return 0.375 * n; };  // sum of the window's squares
    white_ = squared(geometry.width) * squared(geometry.height);
  }
  // Of white noise with a variance of 1.
  double white() const noexcept { return white_; }

  Eigen::ArrayXf of(const Eigen::Ref<const Eigen::Matrix<float, -1, -1, Eigen::RowMajor>>& frame) const {
    const Eigen::Matrix<float, -1, -1, Eigen::RowMajor> about = frame.array() - frame.mean();
    const WaveMatrix rows = down_.transpose() * about.cast<Wave>();
    const WaveMatrix both = rows * across_;
    Eigen::ArrayXf power(static_cast<Index>(at_.size()));
    for (std::size_t i = 0; i < at_.size(); ++i) {
      power[static_cast<Index>(i)] = std::norm(both(kDown + at_[i].down, kAcross + at_[i].across));
    }
    return power;
  }

 private:
  // Samples x frequencies from -most to most.
  static WaveMatrix waves(int samples, int most) {
    WaveMatrix out(samples, 2 * most + 1);
    for (int i = 0; i < samples; ++i) {
      for (int k = -most; k <= most; ++k) {
        const double phase = -2.0 * std::numbers::pi * k * i / samples;
        out(i, most + k) = hann(i, samples) * Wave(std::polar(1.0, phase));
      }
    }
    return out;
  }
  std::vector<Frequency> at_;
  WaveMatrix across_;
  WaveMatrix down_;
  double white_ = 0.0;
};

// The frames whose motion is known and follows that of the frame before.
struct Followed {
  struct Frame {
    bool there = false;              // its motion is known
    std::array<double, 6> affine{};  // SceneMotion::affine
    std::array<double, 2> place{};   // sum of the displacements so far, px
    Eigen::ArrayXf power;
  };
  std::vector<Frame> frames;
  double noise = 0.0;

  // Frames first..last all follow one another.
  bool whole(Index first, Index last) const {
    if (first < 0 || last >= static_cast<Index>(frames.size())) return false;
    return std::all_of(frames.begin() + first, frames.begin() + last + 1, [](const Frame& f) { return f.there; });
  }
  const Frame& at(Index k) const { return frames[static_cast<std::size_t>(k)]; }
};

// Whole periods between two frames of the camera's counter; what went back or stands still counts as lost.
std::uint64_t periods_between(std::uint64_t before, std::uint64_t now) {
  constexpr std::uint64_t kMany = 64;
  return now > before ? std::min(now - before, kMany) : kMany;
}

Result<Followed> follow(const capture::CaptureReader& reader, const Recording& recording, const FrameSpectrum& spectrum,
                        const deblur::Settings& settings) {
  const StreamFormat& format = reader.info().format;
  auto solver = deblur::Solver::create(settings, format, PixelType::kFloat32);
  if (!solver) return Followed{};  // no motion of such frames
  const auto window = static_cast<std::size_t>(settings.window);
  std::vector<std::vector<std::byte>> ring(window, std::vector<std::byte>(plane_bytes(format.geometry, format.type)));
  std::vector<const void*> planes(window, nullptr);
  std::vector<float> values(format.geometry.pixels());
  Followed out;
  out.frames.resize(std::min({reader.info().frames, recording.used.size(), kMostFrames}));
  std::uint64_t newest = 0;
  const auto push = [&](const void* plane) {
    std::shift_left(planes.begin(), planes.end(), 1);
    planes.back() = plane;
    ++newest;
  };
  std::array<double, 2> place{};
  for (std::size_t k = 0; k < out.frames.size(); ++k) {
    const std::uint64_t periods = k == 0 ? 1 : periods_between(reader.frame_id()[k - 1], reader.frame_id()[k]);
    for (std::uint64_t lost = 1; lost < periods; ++lost) push(nullptr);
    std::vector<std::byte>& plane = ring[newest % window];
    if (Status status = reader.read_frame(k, plane.data()); !status) return tl::unexpected(status.error());
    const bool used = recording.is_used(static_cast<Index>(k));
    push(used ? plane.data() : nullptr);
    if (!used || newest < window) continue;
    (*solver)->prepare({planes, settings.window - 1, newest});
    const SceneMotion* motion = (*solver)->motion();
    if (motion == nullptr) continue;
    Followed::Frame& frame = out.frames[k];
    frame.there = periods == 1;
    frame.affine = motion->affine;
    place[0] += motion->affine[0];
    place[1] += motion->affine[3];
    frame.place = place;
    physical_values(format, plane.data(), 0, values);
    frame.power = spectrum.of(Eigen::Map<const Eigen::Matrix<float, -1, -1, Eigen::RowMajor>>(
        values.data(), format.geometry.height, format.geometry.width));
    out.noise = (*solver)->noise_k();
  }
  return out;
}

// A value, and that without each block of the data, as an interval.
template <typename Of>
std::optional<Estimate> jackknifed(int blocks, const Of& without) {
  const std::optional<double> value = without(-1);
  if (!value || blocks < 2) return std::nullopt;
  double squares = 0.0;
  for (int b = 0; b < blocks; ++b) {
    const std::optional<double> other = without(b);
    if (!other) return std::nullopt;
    squares += (*other - *value) * (*other - *value);
  }
  return interval(*value, std::sqrt(squares * (blocks - 1) / blocks));
}

// ------------------------------------------------------------------ contrast against speed

// Where the picture was `back` periods before frame k: Catmull and Rom's cubic through the frames' places.
std::array<double, 2> place_before(const Followed& all, Index k, double back) {
  const auto whole = static_cast<Index>(back);
  const double f = back - static_cast<double>(whole);
  std::array<double, 2> out{};
  for (std::size_t d = 0; d < 2; ++d) {
    const auto p = [&](Index i) { return all.at(k - whole - i).place[d]; };
    const double a = p(-1);
    const double b = p(0);
    const double c = p(1);
    const double e = p(2);
    out[d] = b + 0.5 * f * (c - a + f * (2 * a - 5 * b + 4 * c - e + f * (3 * (b - c) + e - a)));
  }
  return out;
}

struct PixelMemory {
  int steps = 0;           // that it remembers
  Eigen::MatrixXf weight;  // steps x time constants, of what was seen then
};

double tau_tried(double nominal, double index) { return nominal * std::exp(kTauStep * (index - kNominal)); }

PixelMemory pixel_of(double tau_s, double period_s) {
  PixelMemory pixel;
  pixel.steps = static_cast<int>(std::ceil(kMemory * tau_s / period_s)) * kSubsteps;
  pixel.weight.resize(pixel.steps, kTaus);
  for (int t = 0; t < kTaus; ++t) {
    for (int j = 0; j < pixel.steps; ++j) {
      pixel.weight(j, t) = static_cast<float>(std::exp(-(j + 0.5) / kSubsteps * period_s / tau_tried(tau_s, t)));
    }
    pixel.weight.col(t) /= pixel.weight.col(t).sum();
  }
  return pixel;
}

// exp(-i k phase) for k from -most to most.
Eigen::ArrayX<Wave> harmonics(int most, double phase) {
  Eigen::ArrayX<Wave> out(2 * most + 1);
  for (int k = -most; k <= most; ++k) out[most + k] = Wave(std::polar(1.0, -k * phase));
  return out;
}

// Logarithm of the power that the pixel leaves of each frequency in frame k: frequencies x time constants. A frequency
// is seen with its neighbours, as Hann's window mixes them: across a fast motion those differ much.
Eigen::ArrayXXf left_of(const Followed& all, Index k, const PixelMemory& pixel, const std::vector<Frequency>& at,
                        Geometry geometry) {
  constexpr int kColumns = 2 * (kAcross + 1) + 1;
  constexpr int kRows = 2 * (kDown + 1) + 1;
  WaveMatrix waves(kColumns * kRows, pixel.steps);
  const std::array<double, 2> here = all.at(k).place;
  for (int j = 0; j < pixel.steps; ++j) {
    const std::array<double, 2> then = place_before(all, k, (j + 0.5) / kSubsteps);
    const auto x = harmonics(kAcross + 1, 2.0 * std::numbers::pi * (then[0] - here[0]) / geometry.width);
    const auto y = harmonics(kDown + 1, 2.0 * std::numbers::pi * (then[1] - here[1]) / geometry.height);
    for (Index row = 0; row < kRows; ++row) waves.col(j).segment(row * kColumns, kColumns) = x * y[row];
  }
  const WaveMatrix left = waves * pixel.weight.cast<Wave>();
  const Eigen::ArrayXXf power = left.array().abs2();
  constexpr std::array kHann{1.0F / 6.0F, 2.0F / 3.0F, 1.0F / 6.0F};  // squares of its spectrum, their sum 1
  Eigen::ArrayXXf out = Eigen::ArrayXXf::Zero(static_cast<Index>(at.size()), kTaus);
  for (std::size_t i = 0; i < at.size(); ++i) {
    for (int v = 0; v < 3; ++v) {
      for (int u = 0; u < 3; ++u) {
        const int place = (kDown + at[i].down + v) * kColumns + kAcross + at[i].across + u;
        out.row(static_cast<Index>(i)) +=
            kHann[static_cast<std::size_t>(u)] * kHann[static_cast<std::size_t>(v)] * power.row(place);
      }
    }
  }
  constexpr float kNothing = 1e-12F;
  return (out + kNothing).log();
}

// Sum of the deviations of a stretch's frames from one spectrum, for each time constant; empty: too little is seen.
Eigen::ArrayXd deviations(const Followed& all, Index first, const PixelMemory& pixel, const std::vector<Frequency>& at,
                          const FrameSpectrum& spectrum, Geometry geometry) {
  std::array<Eigen::ArrayXXf, kStretch> left;
  for (Index i = 0; i < kStretch; ++i) {
    left[static_cast<std::size_t>(i)] = left_of(all, first + i, pixel, at, geometry);
  }
  const auto noise = static_cast<float>(all.noise * all.noise * spectrum.white());
  Eigen::ArrayXd sums = Eigen::ArrayXd::Zero(kTaus);
  bool any = false;
  std::vector<double> ratio;
  for (Index f = 0; f < static_cast<Index>(at.size()); ++f) {
    const auto power = [&](Index i) { return all.at(first + i).power[f] - noise; };
    const auto nominal = [&](Index i) { return std::exp(left[static_cast<std::size_t>(i)](f, kNominal)); };
    ratio.clear();
    for (Index i = 0; i < kStretch; ++i) ratio.push_back(power(i) / nominal(i));
    const double scene = median(ratio);
    // Which frames count must not depend on their own noise, so it is decided by what they should show.
    std::vector<Index> clear;
    for (Index i = 0; i < kStretch; ++i) {
      if (scene * nominal(i) > kClearPower * noise) clear.push_back(i);
    }
    if (clear.size() < kStretch / 2) continue;
    any = true;
    for (Index t = 0; t < kTaus; ++t) {
      const auto rest = mapped(clear, [&](Index i) -> double {
        return std::log(std::max(power(i), 0.3F * noise)) - left[static_cast<std::size_t>(i)](f, t);
      });
      const double middle = median(rest);
      for (const double r : rest) sums[t] += std::min(std::abs(r - middle), kMostDeviation);
    }
  }
  return any ? sums : Eigen::ArrayXd();
}

// The place of the smallest of values, between them by a parabola; nothing at the ends.
std::optional<double> lowest(const Eigen::ArrayXd& values) {
  Index at = 0;
  values.minCoeff(&at);
  if (at == 0 || at + 1 == values.size()) return std::nullopt;
  const double bend = values[at - 1] - 2.0 * values[at] + values[at + 1];
  return static_cast<double>(at) + 0.5 * (values[at - 1] - values[at + 1]) / std::max(bend, 1e-300);
}

std::optional<Estimate> find_tau(const Followed& all, const FrameSpectrum& spectrum, const std::vector<Frequency>& at,
                                 Geometry geometry, double tau_s, double period_s) {
  const PixelMemory pixel = pixel_of(tau_s, period_s);
  const Index history = pixel.steps / kSubsteps + 2;
  std::vector<Eigen::ArrayXd> stretches;
  for (Index k = 0; k < static_cast<Index>(all.frames.size()); k += kStretch) {
    if (!all.whole(k - history, k + kStretch)) continue;
    if (auto sums = deviations(all, k, pixel, at, spectrum, geometry); sums.size() > 0) stretches.push_back(sums);
  }
  const int count = static_cast<int>(stretches.size());
  if (count < kFewestStretches) return std::nullopt;
  const int blocks = std::min(kLeftOut, count);
  auto found = jackknifed(blocks, [&](int left_out) -> std::optional<double> {
    Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(kTaus);
    for (int s = 0; s < count; ++s) {
      if (s * blocks / count != left_out) sum += stretches[static_cast<std::size_t>(s)];
    }
    const auto place = lowest(sum);
    return place ? std::optional(tau_tried(tau_s, *place)) : std::nullopt;
  });
  return found && found->high - found->low < 2.0 * kWidestInterval * found->value ? found : std::nullopt;
}

// ------------------------------------------------------------------ shear against acceleration

// Velocity along an axis at frame k, px a frame: a difference of the fourth order.
double velocity_at(const Followed& all, Index k, std::size_t axis) {
  const auto p = [&](Index i) { return all.at(k + i).place[axis]; };
  return (8.0 * (p(1) - p(-1)) - (p(2) - p(-2))) / 12.0;
}

struct Shear {
  int block = 0;
  double change = 0.0;  // of the velocity since the frame before, px a frame
  double shear = 0.0;   // px a row
};

std::vector<Shear> shears_of(const Followed& all, std::size_t axis) {
  std::vector<Shear> out;
  const auto count = static_cast<Index>(all.frames.size());
  for (Index k = 3; k + 2 < count; ++k) {
    if (!all.whole(k - 3, k + 2)) continue;
    out.push_back({static_cast<int>(k * kLeftOut / count), velocity_at(all, k, axis) - velocity_at(all, k - 1, axis),
                   all.at(k).affine[3 * axis + 2]});
  }
  if (out.empty()) return out;
  const double middle = median(mapped(out, [](const Shear& s) { return s.shear; }));
  const double spread = kSigmaOfMad * median(mapped(out, [&](const Shear& s) { return std::abs(s.shear - middle); }));
  std::erase_if(out, [&](const Shear& s) { return std::abs(s.shear - middle) > kOutlyingShear * spread; });
  return out;
}

std::optional<Estimate> find_row_delay(const Followed& all, double period_s) {
  double weighted = 0.0;
  double weights = 0.0;
  for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
    const std::vector<Shear> shears = shears_of(all, axis);
    if (shears.size() < static_cast<std::size_t>(kFewestStretches) * kStretch) return std::nullopt;
    const auto one = jackknifed(kLeftOut, [&](int left_out) -> std::optional<double> {
      double products = 0.0;
      double squares = 0.0;
      for (const Shear& s : shears) {
        if (s.block == left_out) continue;
        products += s.change * s.shear;
        squares += s.change * s.change;
      }
      return squares > 0.0 ? std::optional(products / squares * period_s) : std::nullopt;
    });
    if (!one) return std::nullopt;
    const double error = std::max((one->high - one->low) / (2.0 * 1.96), 1e-12);
    weighted += one->value / (error * error);
    weights += 1.0 / (error * error);
  }
  const Estimate found = interval(weighted / weights, 1.0 / std::sqrt(weights));
  return found.high - found.low < 2.0 * kMostDelayError ? std::optional(found) : std::nullopt;
}

}  // namespace

Result<std::optional<FromMotion>> learn_from_motion(const std::filesystem::path& file, const Recording& recording,
                                                    const Session& session, const model::CameraProfile& profile) {
  if (session.period_s > profile.tau_s) return std::optional<FromMotion>();
  auto reader = capture::CaptureReader::open(file);
  if (!reader) return tl::unexpected(reader.error());
  deblur::Settings settings;
  settings.method = deblur::Method::kMotion;
  settings.tau_s = profile.tau_s;
  settings.period_s = session.period_s;
  if (reader->info().frames < static_cast<std::size_t>(settings.window)) return std::optional<FromMotion>();
  const Geometry geometry = reader->info().format.geometry;
  const std::vector<Frequency> at = frequencies();
  const FrameSpectrum spectrum(geometry, at);
  const auto followed = follow(*reader, recording, spectrum, settings);
  if (!followed) return tl::unexpected(followed.error());
  std::vector<double> speeds;
  for (const Followed::Frame& f : followed->frames) {
    if (f.there) speeds.push_back(std::hypot(f.affine[0], f.affine[3]) / session.period_s);
  }
  if (speeds.empty()) return std::optional<FromMotion>();
  FromMotion out;
  out.frames = speeds.size();
  out.fastest_px_s = *std::ranges::max_element(speeds);
  out.usual_px_s = median(std::move(speeds));
  out.tau_s = find_tau(*followed, spectrum, at, geometry, profile.tau_s, session.period_s);
  out.row_delay_s = find_row_delay(*followed, session.period_s * session.row_step);
  return std::optional(out);
}

}  // namespace bolo::diagnose
