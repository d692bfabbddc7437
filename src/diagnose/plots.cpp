// Plots of a fit, and where its gap is located.
#include <iterator>
#include <set>

#include "src/diagnose/stages.hpp"
#include "src/report/drawing.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kFigureWidth = 520.0;  // px: two side by side
constexpr double kHeight = 170.0;       // px
constexpr std::size_t kStretch = 48;    // plotted frames of a pixel's time series

// Residual of one capture.
struct Left {
  Series predicted;
  Series residual;  // K
  std::vector<Index> frames;
  std::vector<float> gap_of;  // rms over these frames of each pixel, in noise floors
  double gap = 0.0;           // rms of these
};

Left left_over(const Session& session, std::size_t i, const State& state, const std::vector<int>& pixels,
               bool used_only, double floor_k) {
  const Recording& r = session.recordings[i];
  const auto any = [](std::size_t) { return true; };
  Left left{predict(session, i, state, pixels), {}, {}, {}};
  left.residual = r.values - left.predicted;
  left.frames = used_only ? r.used_frames() : places_where<Index>(r.used.size(), any);
  double squares = 0.0;
  for (Index p = 0; p < left.residual.cols(); ++p) {
    const double sum = sum_of(left.frames, [&](Index k) {
      const double value = left.residual(k, p) / floor_k;
      return value * value;
    });
    const auto rms = static_cast<float>(std::sqrt(sum / std::max(1.0, static_cast<double>(left.frames.size()))));
    left.gap_of.push_back(rms);
    squares += rms * rms;
  }
  left.gap = std::sqrt(squares / std::max(1.0, static_cast<double>(left.residual.cols())));
  return left;
}

struct Curve {
  std::vector<double> x;
  std::vector<double> y;
};

// Mean residual of each row or column, K.
Curve profile(const Session& session, const Left& left, bool by_row) {
  const std::size_t width = session.grid.columns.size();
  const std::vector<int>& places = by_row ? session.grid.rows : session.grid.columns;
  Curve curve{{places.begin(), places.end()}, std::vector<double>(places.size(), 0.0)};
  const auto pixels = static_cast<std::size_t>(left.residual.cols());
  for (std::size_t p = 0; p < pixels; ++p) {
    double& sum = curve.y[by_row ? p / width : p % width];
    for (const Index k : left.frames) sum += left.residual(k, static_cast<Index>(p));
  }
  const std::size_t values = pixels / places.size() * left.frames.size();  // per row or column
  for (double& y : curve.y) y /= std::max(1.0, static_cast<double>(values));
  return curve;
}

// Power spectrum of the residual in time, averaged over some pixels, K^2/Hz.
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

plot::Plot map_plot(const std::string& title, const std::string& unit, Geometry size, std::vector<float> values) {
  const bool below = std::ranges::any_of(values, [](float v) { return std::isfinite(v) && v < 0.0F; });
  const bool above = std::ranges::any_of(values, [](float v) { return std::isfinite(v) && v > 0.0F; });
  constexpr double kSides = 60.0;  // px, width of the axis
  plot::Plot plot{.title = title, .x = {.name = "column"}, .y = {.name = "row"}, .width = kFigureWidth};
  plot.plane = {.width = size.width,
                .height = size.height,
                .values = std::move(values),
                .ramp = below && above ? plot::Ramp::kDiverging : plot::Ramp::kViridis,
                .unit = unit};
  plot.height = (kFigureWidth - kSides) * std::max(1, size.height) / std::max(1, size.width);
  return plot;
}

// Two planes on one colour scale.
std::vector<plot::Plot> beside(plot::Plot left, plot::Plot right) {
  const plot::PlaneSpan span = plot::span_of(left.plane);
  for (plot::Plot* one : {&left, &right}) {
    one->plane.low = span.low;
    one->plane.high = span.high;
  }
  return {std::move(left), std::move(right)};
}

// The part of a picture with the least variance, a quarter of its width and height.
struct EvenPart {
  Geometry size;
  int row = 0;
  int column = 0;

  auto at(const ArrayXf& picture, Geometry whole, int y, int x) const {
    return Eigen::Map<const Series>(picture.data(), whole.height, whole.width).block(y, x, size.height, size.width);
  }

  EvenPart(const ArrayXf& picture, Geometry whole) : size{whole.width / 4, whole.height / 4} {
    constexpr int kStep = 8;  // px
    double least = std::numeric_limits<double>::infinity();
    for (int y = 0; y <= whole.height - size.height; y += kStep) {
      for (int x = 0; x <= whole.width - size.width; x += kStep) {
        const auto part = at(picture, whole, y, x).array();
        const auto variance = static_cast<double>((part - part.mean()).square().mean());
        if (!(variance < least)) continue;
        least = variance;
        row = y;
        column = x;
      }
    }
  }

  std::vector<float> of(const ArrayXf& picture, Geometry whole) const {
    const Series part = at(picture, whole, row, column);
    return {part.data(), part.data() + part.size()};
  }
};

plot::Plot grid_plot(const Session& session, const std::string& title, const std::string& unit,
                     std::vector<float> values) {
  const Geometry size{static_cast<int>(session.grid.columns.size()), static_cast<int>(session.grid.rows.size())};
  return map_plot(title, unit, size, std::move(values));
}

std::vector<plot::Series> both(const Curve& before, const Curve& after, double factor) {
  std::vector<plot::Series> series{{.label = "before", .hue = plot::Hue::kBlurred, .x = before.x, .y = before.y},
                                   {.label = "after", .hue = plot::Hue::kDeblurred, .x = after.x, .y = after.y}};
  for (plot::Series& one : series) {
    for (double& y : one.y) y *= factor;
  }
  return series;
}

// An axis symmetric about zero with at least this reach, so that negligible values look negligible.
plot::Axis reaching(plot::Axis axis, double least, const std::vector<plot::Series>& series) {
  double reach = least;
  for (const plot::Series& one : series) {
    for (const double y : one.y) reach = std::isfinite(y) ? std::max(reach, 1.05 * std::abs(y)) : reach;
  }
  axis.low = -reach;
  axis.high = reach;
  return axis;
}

// Gap maps before and after on one colour scale, from a little below the noise floor to the largest gap.
std::array<plot::Plot, 2> gap_plots(const Session& session, const Left& before, const Left& after) {
  std::array plots{grid_plot(session, "Gap before", "noise floors", before.gap_of),
                   grid_plot(session, "Gap after", "noise floors", after.gap_of)};
  plots[0].caption = "Of each pixel, over time.";
  plots[1].caption = "In the same colours: 1 everywhere is good. The rim of two pixels is not fitted.";
  double high = 2.0;
  for (const plot::Plot& one : plots) {
    for (const float v : one.plane.values) high = std::isfinite(v) ? std::max(high, static_cast<double>(v)) : high;
  }
  for (plot::Plot& one : plots) {
    one.plane.ramp = plot::Ramp::kViridis;
    one.plane.low = 0.8;
    one.plane.high = high;
  }
  return plots;
}

plot::Plot profile_plot(const Session& session, const Left& before, const Left& after, double floor_k, bool rows) {
  plot::Plot plot{.title = rows ? "Mean residual of each row" : "Mean residual of each column",
                  .caption = rows ? "A slope from top to bottom is a delay from row to row; jumps are fixed offsets."
                                  : "A pattern here is fixed in the columns, or the stimulus moves across them.",
                  .x = {.name = rows ? "row" : "column"},
                  .series = both(profile(session, before, rows), profile(session, after, rows), 1e3),
                  .sideways = rows,
                  .width = kFigureWidth,
                  .height = kHeight};
  plot.y = reaching({.name = "residual", .unit = "mK"}, 250.0 * floor_k, plot.series);
  return plot;
}

plot::Plot spectrum_plot(const Curve& before, const Curve& after) {
  return {.title = "Spectrum of the residual",
          .caption = "Flat is white noise. A rise to the left is slow (drift, heat); a line is periodic.",
          .x = {.name = "frequency", .unit = "Hz", .logarithmic = true},
          .y = {.name = "power", .unit = "K\u00b2/Hz", .logarithmic = true},
          .series = both(before, after, 1.0),
          .width = kFigureWidth,
          .height = kHeight};
}

// The frames with the largest deviation from the nominal simulator.
Course stretch_of(const Course& whole) {
  const std::size_t size = whole.t_s.size();
  std::size_t worst = 0;
  double largest = -1.0;
  for (std::size_t i = 0; i < size; ++i) {
    const double apart = std::abs(whole.measured[i] - whole.nominal[i]);
    if (apart <= largest || !std::isfinite(apart)) continue;
    largest = apart;
    worst = i;
  }
  const std::size_t length = std::min(size, kStretch);
  const auto begin = static_cast<std::ptrdiff_t>(std::min(worst - std::min(worst, kStretch / 2), size - length));
  const auto part = [&](const std::vector<double>& of) {
    return std::vector<double>(of.begin() + begin, of.begin() + begin + static_cast<std::ptrdiff_t>(length));
  };
  return {part(whole.t_s), part(whole.measured), part(whole.nominal), part(whole.predicted)};
}

Curve apart(const Course& course, const std::vector<double>& predicted) {
  Curve out{course.t_s, course.measured};
  std::ranges::transform(out.y, predicted, out.y.begin(), std::minus{});
  return out;
}

std::vector<double> trace(const Series& values, Index pixel) {
  const Eigen::ArrayXd y = values.col(pixel).cast<double>().array();
  return {y.begin(), y.end()};
}

// A pixel over kCellFrames frames whose nominal residual is well above the noise (kMuch).
struct MissedCell {
  double row = 0.0;
  double column = 0.0;
  double t_s = 0.0;
  double kelvin = 0.0;
  Index pixel = 0;
};

void find_missed(const Session& session, const Recording& r, const Left& left, double floor_k,
                 std::vector<MissedCell>& missed) {
  constexpr double kMuch = 2.6;  // squared floors: about 1.6^2
  for (Index p = 0; p < left.residual.cols(); ++p) {
    for (Index from = 0; from < left.residual.rows(); from += kCellFrames) {
      const Index length = std::min<Index>(kCellFrames, left.residual.rows() - from);
      const double square = left.residual.col(p).segment(from, length).squaredNorm() / (floor_k * floor_k);
      if (square / static_cast<double>(length) < kMuch) continue;
      missed.push_back({static_cast<double>(session.grid.row_of(p)), static_cast<double>(session.grid.column_of(p)),
                        r.time_of(from), left.predicted(from + length / 2, p), p});
    }
  }
}

void locate(const Session& session, const std::vector<MissedCell>& missed, Location& where) {
  if (missed.empty()) return;
  // Range of the values without one percent at either end.
  const auto middle = [&missed](double MissedCell::*of) {
    std::vector<double> values = mapped(missed, of);
    std::ranges::sort(values);
    const std::size_t cut = values.size() / 100;
    return std::pair{values[cut], values[values.size() - 1 - cut]};
  };
  const auto [first_row, last_row] = middle(&MissedCell::row);
  const auto [first_column, last_column] = middle(&MissedCell::column);
  const auto [from_s, to_s] = middle(&MissedCell::t_s);
  where.row_first = static_cast<int>(first_row);
  where.row_last = static_cast<int>(last_row);
  where.column_first = static_cast<int>(first_column);
  where.column_last = static_cast<int>(last_column);
  where.time_s = {{from_s, to_s + static_cast<double>(kCellFrames) * session.period_s}};
  where.temperature_k = middle(&MissedCell::kelvin);
  std::set<Index> pixels;
  for (const MissedCell& cell : missed) pixels.insert(cell.pixel);
  where.pixel_fraction = static_cast<double>(pixels.size()) / static_cast<double>(session.grid.pixels());
}

// The frequency band with 90 % of a residual's power above the floor.
std::pair<double, double> band(const Curve& spectrum, double floor) {
  constexpr double kAboveFloor = 1.3;
  const auto above = [&](double y) { return std::max(0.0, y - kAboveFloor * floor); };
  const double all = sum_of(spectrum.y, above);
  if (all <= 0.0) return {0.0, 0.0};
  // Frequency at which the sum first exceeds this share of the total.
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

plot::Rows scene_plots(const SceneFrame& frame) {
  const EvenPart part(frame.corrected, frame.geometry);
  const auto whole = [&](const char* title, const ArrayXf& values) {
    return map_plot(title, "", frame.geometry, {values.begin(), values.end()});
  };
  const auto even = [&](const char* title, const ArrayXf& values) {
    return map_plot(title, "", part.size, part.of(values, frame.geometry));
  };
  plot::Rows rows{
      beside(whole("A frame, as it came", frame.came), whole("The same without the pixels' offsets", frame.corrected)),
      beside(even("Its most even part, as it came", frame.came),
             even("The same part without the offsets", frame.corrected)),
      beside(whole("What other frames miss of it", frame.missed),
             whole("What they miss without the offsets", frame.left))};
  for (plot::Plot* one : {&rows[0][0], &rows[0][1], &rows[1][0], &rows[1][1]}) one->plane.ramp = plot::Ramp::kIron;
  return rows;
}

std::vector<plot::Plot> course_plots(const Course& whole, double floor_k) {
  const Course course = stretch_of(whole);
  plot::Plot answer{
      .title = "One pixel where it is furthest off",
      .caption = "The dots should lie on the solid line; how far they are from the dashed one is the gap.",
      .x = {.name = "time", .unit = "s"},
      .y = {.name = "temperature", .unit = "K"},
      .series = {{.label = "nominal simulator",
                  .hue = plot::Hue::kBlurred,
                  .x = course.t_s,
                  .y = course.nominal,
                  .dashed = true},
                 {.label = "with the effects", .hue = plot::Hue::kDeblurred, .x = course.t_s, .y = course.predicted},
                 {.kind = plot::Kind::kPoints,
                  .label = "camera",
                  .hue = plot::Hue::kTruth,
                  .x = course.t_s,
                  .y = course.measured}},
      .width = kFigureWidth,
      .height = kHeight};
  plot::Plot residual{.title = "Residual of the same pixel",
                      .caption = "Camera minus prediction. What stays in the band, twice the noise floor, is no gap.",
                      .x = {.name = "time", .unit = "s"},
                      .series = both(apart(course, course.nominal), apart(course, course.predicted), 1e3),
                      .width = kFigureWidth,
                      .height = kHeight};
  residual.y = reaching({.name = "residual", .unit = "mK"}, 2500.0 * floor_k, residual.series);
  const double noise_mk = 2e3 * floor_k;
  residual.series.insert(residual.series.begin(), {.kind = plot::Kind::kBand,
                                                   .hue = plot::Hue::kSoft,
                                                   .x = {course.t_s.front(), course.t_s.back()},
                                                   .y = {-noise_mk, -noise_mk},
                                                   .to = {noise_mk, noise_mk}});
  return {std::move(answer), std::move(residual)};
}

void fill_plots(const Fit& fit, double floor_k, Report& report) {
  const Session& raw = fit.raw;
  const Session& session = fit.session;
  const std::vector<int> pixels = session.grid.all();
  const auto columns = static_cast<Index>(session.grid.columns.size());
  Index pixel = static_cast<Index>(session.grid.rows.size() / 2) * columns + columns / 2;  // the middle one
  if (!session.is_good(pixel)) pixel = std::ranges::find(session.good, 1) - session.good.begin();
  std::vector<MissedCell> missed;
  double widest = 0.0;
  for (const std::size_t i : modelled(session)) {
    const Recording& r = session.recordings[i];
    const Left before = left_over(raw, i, fit.nominal, pixels, false, floor_k);
    const Left after = left_over(session, i, fit.state, pixels, true, floor_k);
    const Curve spectrum_before = spectrum(session, before);
    CapturePlots& out = report.captures.emplace_back(
        CapturePlots{r.name, std::string(name_of(r.kind)), {fit.before.gap(i), fit.selection.fit.score.gap(i)}, {}});
    std::ranges::move(gap_plots(session, before, after), std::back_inserter(out.plots));
    std::ranges::move(course_plots({r.t, trace(raw.recordings[i].values, pixel), trace(before.predicted, pixel),
                                    trace(after.predicted, pixel)},
                                   floor_k),
                      std::back_inserter(out.plots));
    out.plots.push_back(spectrum_plot(spectrum_before, spectrum(session, after)));
    for (const bool rows : {false, true}) out.plots.push_back(profile_plot(session, before, after, floor_k, rows));
    find_missed(session, r, before, floor_k, missed);
    if (before.gap <= widest) continue;
    widest = before.gap;
    report.location.band_hz = band(spectrum_before, 2.0 * floor_k * floor_k * session.period_s);
  }
  locate(session, missed, report.location);
  const auto add_map = [&](const char* title, const char* unit, const auto& value_of) {
    report.maps.push_back(grid_plot(session, title, unit, mapped(pixels, value_of)));
    report.maps.back().caption = "Blank where there is no value.";
  };
  const auto add_values = [&](const Eigen::VectorXf& values, const char* title, const char* unit, float factor) {
    if (values.size() == 0) return;
    add_map(title, unit,
            [&](int p) { return session.is_good(p) ? values[p] * factor : std::numeric_limits<float>::quiet_NaN(); });
  };
  const CameraModel& c = fit.state.camera;
  add_values(c.offset, "Offset of each pixel", "mK", 1000.0F);
  add_values(c.gain, "Gain of each pixel", "%", 100.0F);
  add_values(c.tau, "Time constant of each pixel", "%", 100.0F);
  if (std::ranges::count(session.good, 0) == 0) return;
  add_map("Pixels left out", "1 = dead or jumping", [&](int p) { return session.is_good(p) ? 0.0F : 1.0F; });
}

}  // namespace bolo::diagnose
