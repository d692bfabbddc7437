// Effects of the read-out and of the package: times of rows and frames, offsets and gains.
#include <algorithm>
#include <cmath>

#include "src/diagnose/effect.hpp"
#include "src/diagnose/noise.hpp"

namespace bolo::diagnose {
namespace {

// Rows are sampled one after another.
Effect row_delay() {
  return {.name = "row_delay",
          .stage = "readout",
          .needs = "a pan over bars; two of them, in both directions, tell it from an error of the target",
          .told_by = any_of({Kind::kChopper, Kind::kMovingBars}),
          .parameters = always({number_of("row_delay_s", 1e-5, -2e-4, 2e-4, &CameraModel::row_delay_s)}),
          .least = 5e-07,
          .forms = {{"rolling", [](State& s) { s.camera.two_halves = false; }},
                    {"halves", [](State& s) { s.camera.two_halves = true; }}},
          .report = first_as("row_delay_s")};
}

// The read-out averages over a part of the frame. Its mean delay is a start phase; its square is what shows.
Effect integration_window() {
  return {
      .name = "integration_window",
      .stage = "readout",
      .needs = "a chopper, and pans over bars at two speeds",
      .told_by = any_of({Kind::kChopper, Kind::kMovingBars}),
      .parameters = always({{"window_s2", 4e-6, 0.0, 4e-5,
                             [](const State& s) { return s.camera.response.window_s * s.camera.response.window_s; },
                             [](State& s, double v) { s.camera.response.window_s = std::sqrt(std::max(0.0, v)); }}}),
      .least = 4e-08,
      .report = [](const Fitted& f) {
        return Estimates{{"window_s", root_interval(f.value[0], f.error[0])}};
      }};
}

// The frame period is not the nominal one. Pans cannot tell it from their own speed; a chopper can.
Effect clock_skew() {
  return {.name = "clock_skew",
          .stage = "transport",
          .needs = "a chopper, or two pans over bars",
          .told_by = any_of({Kind::kChopper, Kind::kMovingBars}),
          .parameters = always({number_of("skew", 0.0002, -0.02, 0.02, &CameraModel::clock_skew)}),
          .least = 1e-05,
          .report = first_as("skew")};
}

// Every pixel and every column has an offset of its own.
Effect fpn_offset() {
  return {.name = "fpn_offset",
          .stage = "readout",
          .needs = "a closed shutter",
          .told_by = any_of({Kind::kUniform, Kind::kChopper, Kind::kStillBars}),
          .map = MapKind::kOffset,
          .least = 0.0015,
          .report = [](const Fitted& f) {
            const MapSpread spread = spread_of(f.session, f.state.camera.offset);
            const double columns = 0.71 / std::sqrt(std::max(1.0, static_cast<double>(f.session.grid.columns.size())));
            return Estimates{{"pixel_k", interval(spread.pixel, 1.5 * spread.relative_error() * spread.pixel)},
                             {"column_k", interval(spread.column, columns * spread.column)}};
          }};
}

// Every pixel has a gain of its own.
Effect fpn_gain() {
  return {.name = "fpn_gain",
          .stage = "readout",
          .needs = "flat black bodies at two temperatures",
          .told_by =
              [](const Session& s) {
                return std::ranges::count(s.recordings, Kind::kUniform, &Recording::kind) > 1 ||
                       has_kind(s, Kind::kChopper);
              },
          .map = MapKind::kGain,
          .least = 0.00025,
          .report = rms_of(MapKind::kGain)};
}

// Heating by the bias pulse: an offset that grows with the time of the row in the frame.
Effect self_heating() {
  constexpr double kRate = 3.0;  // about which it is looked for
  return {.name = "self_heating",
          .stage = "readout",
          .needs = "a closed shutter",
          .told_by = any_of({Kind::kUniform}),
          .parameters = always(
              {number_of("heating_k", 0.02, -5.0, 5.0, &CameraModel::heating_k),
               {"log_rate", 0.1, -2.5, 2.5, [](const State& s) { return std::log(s.camera.heating_rate / kRate); },
                [](State& s, double v) { s.camera.heating_rate = kRate * std::exp(v); }}}),
          .least = 0.001,
          .hides_in = MapKind::kOffset,
          .report = [](const Fitted& f) {
            return Estimates{{"amplitude_k", interval(std::abs(f.value[0]), f.error[0])}};
          }};
}

// A cubic in time for each recording: three parameters each.
std::vector<Parameter> cubics(const Session& session) {
  std::vector<Parameter> all;
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    if (!has_model(session.recordings[i])) continue;
    for (std::size_t power = 0; power < 3; ++power) {
      all.push_back({"drift", 0.01, -5.0, 5.0,
                     [i, power](const State& s) { return s.camera.drift.empty() ? 0.0 : s.camera.drift[i][power]; },
                     [i, power](State& s, double v) {
                       if (s.camera.drift.empty()) s.camera.drift.resize(s.stimuli.size());
                       s.camera.drift[i][power] = v;
                     }});
    }
  }
  return all;
}

// The offset of all pixels moves slowly with the temperature of the package.
Effect drift() {
  return {.name = "drift",
          .stage = "package",
          .needs = "a closed shutter over a second or more",
          .told_by = any_of({Kind::kUniform, Kind::kChopper}),
          .parameters = cubics,
          .map = MapKind::kDrift,
          .suspected_by = [](const NoiseStatistics& n) { return n.drift_p < 1e-6 && n.drift_k > 0.003; },
          .report =
              [](const Fitted& f) {
                double largest = 0.0;
                for (const auto& d : f.state.camera.drift) largest = std::max(largest, 2.0 * std::abs(d[0]));
                double error = 0.0;
                for (const double one : f.error) error = std::max(error, 2.0 * one);
                return Estimates{{"change_k", interval(largest, error)}};
              }};
}

}  // namespace

std::vector<Effect> readout_effects() {
  return {row_delay(), integration_window(), clock_skew(), fpn_offset(), fpn_gain(), self_heating(), drift()};
}

}  // namespace bolo::diagnose
