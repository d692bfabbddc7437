// What the report draws.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "src/core/statistics.hpp"
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

struct Left {
  Series predicted;
  Series residual;  // K
  std::vector<Index> frames;
};

Left left_over(const Session& session, std::size_t i, const State& state, const std::vector<int>& pixels,
               bool used_only) {
  const Recording& r = session.recordings[i];
  Left left{predict(session, i, state, pixels), {}, r.used_frames()};
  left.residual = r.values - left.predicted;
  if (used_only) return left;
  left.frames.resize(r.used.size());
  std::iota(left.frames.begin(), left.frames.end(), 0);
  return left;
}

// A map of the grid's pixels, still without values.
Map empty_map(const Session& session, const std::string& title, const std::string& unit) {
  return {title, unit, static_cast<int>(session.grid.columns.size()), static_cast<int>(session.grid.rows.size()), {}};
}

Curve profile(const Session& session, const Left& left, bool by_row) {
  const std::size_t width = session.grid.columns.size();
  const std::vector<int>& places = by_row ? session.grid.rows : session.grid.columns;
  Curve curve{{places.begin(), places.end()}, std::vector<double>(places.size(), 0.0)};
  const auto pixels = static_cast<std::size_t>(left.residual.cols());
  for (std::size_t p = 0; p < pixels; ++p) {
    double& sum = curve.y[by_row ? p / width : p % width];
    for (const Index k : left.frames) sum += left.residual(k, static_cast<Index>(p));
  }
  const std::size_t values = pixels / places.size() * left.frames.size();  // of each place
  for (double& y : curve.y) y /= std::max(1.0, static_cast<double>(values));
  return curve;
}

Curve spectrum(const Session& session, const Left& left) {
  std::vector<double> power;
  const Index stride = std::max<Index>(1, left.residual.cols() / 96);
  double pixels = 0.0;
  for (Index p = 0; p < left.residual.cols(); p += stride) {
    if (!session.is_good(p)) continue;
    const std::vector<double> one = periodogram(left.residual.col(p).cast<double>().array());
    power.resize(one.size(), 0.0);
    for (std::size_t j = 0; j < one.size(); ++j) power[j] += 2.0 * one[j] * session.period_s;
    pixels += 1.0;
  }
  Curve curve;
  for (std::size_t j = 1; j < power.size(); ++j) {
    curve.x.push_back(static_cast<double>(j) / (static_cast<double>(left.residual.rows()) * session.period_s));
    curve.y.push_back(power[j] / std::max(1.0, pixels));
  }
  return curve;
}

CapturePlots::Side side(const Session& session, const Left& left, double floor_k) {
  CapturePlots::Side out{0.0, empty_map(session, "", "noise floors"), profile(session, left, true),
                         profile(session, left, false), spectrum(session, left)};
  double squares = 0.0;
  for (Index p = 0; p < left.residual.cols(); ++p) {
    const double sum = sum_of(left.frames, [&](Index k) {
      const double value = left.residual(k, p) / floor_k;
      return value * value;
    });
    const auto rms = static_cast<float>(std::sqrt(sum / std::max(1.0, static_cast<double>(left.frames.size()))));
    out.gap_map.values.push_back(rms);
    squares += rms * rms;
  }
  out.gap = std::sqrt(squares / std::max(1.0, static_cast<double>(left.residual.cols())));
  return out;
}

Curve trace(const Recording& r, const Series& values, Index pixel) {
  const Eigen::ArrayXd y = values.col(pixel).cast<double>().array();
  return {r.t, {y.begin(), y.end()}};
}

// Where and when the gap before lies: cells that miss by more than half as much again as the noise.
class Where {
 public:
  void add(const Session& session, std::size_t i, const Left& left, double floor_k) {
    const Recording& r = session.recordings[i];
    constexpr double kMuch = 2.6;  // squared floors: half as much again as the noise, and a little
    for (Index p = 0; p < left.residual.cols(); ++p) {
      for (Index from = 0; from < left.residual.rows(); from += kCellFrames) {
        const Index length = std::min<Index>(kCellFrames, left.residual.rows() - from);
        const double square = left.residual.col(p).segment(from, length).squaredNorm() / (floor_k * floor_k);
        if (square / static_cast<double>(length) < kMuch) continue;
        rows_.push_back(session.grid.row_of(p));
        columns_.push_back(session.grid.column_of(p));
        times_.push_back(r.time_of(from));
        temperatures_.push_back(left.predicted(from + length / 2, p));
        pixel_bad_.resize(static_cast<std::size_t>(left.residual.cols()), 0);
        pixel_bad_[static_cast<std::size_t>(p)] = 1;
      }
    }
  }
  void fill(const Session& session, Location& where) {
    if (rows_.empty()) return;
    const auto [r0, r1] = middle(rows_);
    const auto [c0, c1] = middle(columns_);
    const auto [t0, t1] = middle(times_);
    where.row_first = static_cast<int>(r0);
    where.row_last = static_cast<int>(r1);
    where.column_first = static_cast<int>(c0);
    where.column_last = static_cast<int>(c1);
    where.time_s = {{t0, t1 + static_cast<double>(kCellFrames) * session.period_s}};
    where.temperature_k = middle(temperatures_);
    where.pixel_fraction =
        static_cast<double>(std::ranges::count(pixel_bad_, 1)) / static_cast<double>(pixel_bad_.size());
  }

 private:
  // All but a hundredth on either side.
  template <typename T>
  static std::pair<double, double> middle(std::vector<T>& values) {
    std::ranges::sort(values);
    const std::size_t cut = values.size() / 100;
    return {static_cast<double>(values[cut]), static_cast<double>(values[values.size() - 1 - cut])};
  }
  std::vector<int> rows_;
  std::vector<int> columns_;
  std::vector<double> times_;
  std::vector<double> temperatures_;
  std::vector<char> pixel_bad_;
};

// The band that holds nine tenths of what a residual has above the floor.
std::pair<double, double> band(const Curve& spectrum, double floor) {
  constexpr double kAboveFloor = 1.3;
  const auto above = [&](double y) { return std::max(0.0, y - kAboveFloor * floor); };
  const double all = sum_of(spectrum.y, above);
  if (all <= 0.0) return {0.0, 0.0};
  // Where the sum first exceeds a share of the whole.
  const auto reaches = [&](double share, double otherwise) {
    double sum = 0.0;
    for (std::size_t j = 0; j < spectrum.x.size(); ++j) {
      sum += above(spectrum.y[j]);
      if (sum > share * all) return spectrum.x[j];
    }
    return otherwise;
  };
  return {reaches(0.05, spectrum.x.front()), reaches(0.95, spectrum.x.back())};
}

}  // namespace

void fill_plots(const Fit& fit, double floor_k, Report& report) {
  const Session& raw = fit.raw;
  const Session& session = fit.session;
  const std::vector<int> pixels = session.grid.all();
  Where where;
  double widest = 0.0;
  for (const std::size_t i : modelled(session)) {
    const Recording& r = session.recordings[i];
    const Left before = left_over(raw, i, fit.nominal, pixels, false);
    const Left after = left_over(session, i, fit.state, pixels, true);
    Index pixel = session.grid.pixels() / 2 + static_cast<Index>(session.grid.columns.size()) / 2;
    if (!session.is_good(pixel)) pixel = std::ranges::find(session.good, 1) - session.good.begin();
    report.captures.push_back({r.name, std::string(name_of(r.kind)), side(session, before, floor_k),
                               side(session, after, floor_k), trace(r, raw.recordings[i].values, pixel),
                               trace(r, before.predicted, pixel), trace(r, after.predicted, pixel)});
    where.add(raw, i, before, floor_k);
    const CapturePlots::Side& shown = report.captures.back().before;
    if (shown.gap > widest) {
      widest = shown.gap;
      report.location.band_hz = band(shown.spectrum, 2.0 * floor_k * floor_k * session.period_s);
    }
  }
  where.fill(session, report.location);
  const auto add_map = [&](const Eigen::VectorXf& values, const char* title, const char* unit, float factor) {
    if (values.size() == 0) return;
    Map& map = report.maps.emplace_back(empty_map(session, title, unit));
    for (Index p = 0; p < values.size(); ++p) {
      map.values.push_back(session.is_good(p) ? values[p] * factor : std::numeric_limits<float>::quiet_NaN());
    }
  };
  const CameraModel& c = fit.state.camera;
  add_map(c.offset, "Offset of each pixel", "mK", 1000.0F);
  add_map(c.gain, "Gain of each pixel", "%", 100.0F);
  add_map(c.tau, "Time constant of each pixel", "%", 100.0F);
  if (std::ranges::count(session.good, 0) == 0) return;
  Map& map = report.maps.emplace_back(empty_map(session, "Pixels left out", "1 = dead or jumping"));
  for (const char good : session.good) map.values.push_back(good != 0 ? 0.0F : 1.0F);
}

}  // namespace bolo::diagnose
