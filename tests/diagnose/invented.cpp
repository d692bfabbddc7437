#include "tests/diagnose/invented.hpp"

namespace bolo::diagnose::test {
namespace {

constexpr int kWidth = 32;
constexpr int kHeight = 24;

// Reproducible values in [-1, 1).
struct Dice {
  std::uint64_t state = 1;
  double next() {
    state = state * 6364136223846793005U + 1442695040888963407U;
    return static_cast<double>(state >> 11U) / 4503599627370496.0 - 1.0;
  }
};

plot::Plot gap_map(double top, double bottom, Dice& dice) {
  plot::Plot map{.title = "gap", .plane = {.width = kWidth, .height = kHeight, .unit = "noise floors"}};
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double along = static_cast<double>(y) / (kHeight - 1);
      map.plane.values.push_back(static_cast<float>(top + (bottom - top) * along + 0.08 * dice.next()));
    }
  }
  return map;
}

plot::Plot profile(double slope_k, Dice& dice) {
  plot::Plot plot{.title = "profile", .series = {{.label = "before"}}};
  for (int i = 0; i < kHeight; ++i) {
    plot.series[0].x.push_back(i);
    plot.series[0].y.push_back(slope_k * i / kHeight + 0.002 * dice.next());
  }
  return plot;
}

CapturePlots plots(const char* file, const char* kind, double before, double after) {
  Dice dice{static_cast<std::uint64_t>(before * 1000.0) + 7U};
  return {file,
          kind,
          before,
          after,
          {gap_map(1.0, 2.0 * before - 1.0, dice), gap_map(after, after, dice), profile(0.03 * (before - 1.0), dice)}};
}

void add_noise(Report& report, double stripes_k) {
  report.noise_floor_k = 0.0301;
  report.noise = {{"sigma_tvh", 0.0301, 0.0302, 0.0302},
                  {"sigma_tv", 0.0004, 0.0, 0.0004},
                  {"sigma_th", stripes_k, 0.0, stripes_k},
                  {"sigma_t", 0.0006, 0.0, 0.0005}};
}

void add_captures(Report& report, double strongest) {
  report.captures = {plots("01-shutter.h5", "uniform", 1.0, 1.0),
                     plots("02-hot.h5", "uniform", 1.0, 1.0),
                     plots("03-chopper.h5", "chopper", 1.0 + 0.6 * (strongest - 1.0), 1.01),
                     plots("04-pan-slow.h5", "bar_target", 1.0 + 0.3 * (strongest - 1.0), 1.0),
                     plots("05-pan-fast.h5", "bar_target", strongest, 1.02),
                     plots("06-target.h5", "bar_target", 1.0, 1.0)};
  for (const CapturePlots& one : report.captures) {
    report.inputs.push_back("bench/" + one.file);
    report.location.captures[one.file] = one.gap_before;
  }
  report.frames = 2000;
  report.seconds = 3.4;
}

}  // namespace

Report invented_row_delay() {
  Report report;
  report.gap_before = 7.9;
  report.gap_after = 1.02;
  report.closed_fraction = (7.9 - 1.02) / 6.9;
  report.verdict = "explained";
  report.effects = {{"row_delay",
                     "readout",
                     0.99,
                     7.9,
                     1.02,
                     false,
                     {{"row_delay_s", {2.79e-5, 2.6e-5, 3.01e-5}}},
                     {{"clock_skew", 6.8}, {"tau_global", 7.1}, {"integration_window", 7.2}}}};
  report.location = {"readout", {}, 1, kHeight - 1, 0, kWidth - 1, 0.97, {{0.0, 1.6}, {2.1, 2.4}}, {5, 60}, {298, 308}};
  report.unexplained.p_value = 0.4;
  report.not_identifiable = {{"emissivity", "a flat black body at a third temperature"}};
  Dice dice;
  report.maps = {gap_map(11.0, 11.0, dice)};
  report.maps[0].title = "Time constant of each pixel";
  add_noise(report, 0.0005);
  add_captures(report, 9.1);
  return report;
}

Report invented_mixture() {
  Report report = invented_row_delay();
  report.verdict = "partly_explained";
  report.gap_before = 14.2;
  report.gap_after = 1.31;
  report.closed_fraction = (14.2 - 1.31) / 13.2;
  report.noise_gap_before = 1.42;
  report.noise_gap_after = 1.01;
  report.effects = {
      {"tau_global",
       "pixel",
       1.0,
       14.2,
       3.4,
       false,
       {{"scale", {1.12, 1.118, 1.123}}},
       {{"iir", 5.2}, {"slow_pole", 9.7}}},
      {"fpn_gain", "readout", 0.97, 3.4, 1.31, false, {{"rms", {0.0061, 0.0058, 0.0064}}}, {{"vignetting", 2.9}}},
      {"stripes",
       "readout",
       0.93,
       1.42,
       1.01,
       true,
       {{"column_k", {0.012, 0.0115, 0.0124}}, {"row_k", {0.006, 0.0057, 0.0063}}},
       {{"flicker", 1.33}}}};
  report.stimulus = {{"03-chopper.h5", {{"sweep_s", 0.0021}, {"level_error_k", 0.31}, {"start_s", -0.0014}}},
                     {"05-pan-fast.h5", {{"velocity_error", 0.008}, {"start_s", 0.011}}}};
  report.unexplained = {0.0004, "firmware", "Rows 12 to 23 of 05-pan-fast.h5 jump at 1.25 s, in all columns alike"};
  report.not_identifiable = {{"emissivity", "a flat black body at a third temperature"},
                             {"slow_pole", "chopper pulses longer than 200 ms"}};
  report.warnings = {"07-field.h5: 12 frames only; left out"};
  report.withheld = {"offset_jump"};
  report.captures.clear();
  report.inputs.clear();
  add_noise(report, 0.012);
  add_captures(report, 15.8);
  return report;
}

Report invented_clean() {
  Report report;
  report.unexplained.p_value = 0.62;
  report.not_identifiable = {{"emissivity", "a flat black body at a third temperature"}};
  add_noise(report, 0.0005);
  add_captures(report, 1.01);
  return report;
}

}  // namespace bolo::diagnose::test
