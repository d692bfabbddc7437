// Gains, offsets and limits of the read-out.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {
namespace {

constexpr double kScenes = std::numeric_limits<double>::quiet_NaN();  // level derived from the scene's range
constexpr double kCut = 0.15;                                         // fraction of that range

auto fixed_gains(const EffectSetup& setup) {
  std::vector<double> excess = normal_plane(setup.pattern_seed(), setup.geometry());  // gain - 1
  for (double& one : excess) one *= setup.number("rms");
  return [excess = std::move(excess), reference_k = setup.number("reference_k")](const FrameInstant&, int row,
                                                                                 std::span<double> kelvin) {
    const auto own = row_of(excess, row, kelvin.size());
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += own[x] * (kelvin[x] - reference_k);
  };
}

// Per-pixel and per-column offsets, the same in all frames of the camera.
auto fixed_offsets(const EffectSetup& setup) {
  std::vector<double> offset_k = normal_plane(setup.pattern_seed(), setup.geometry());
  std::vector<double> column(static_cast<std::size_t>(setup.geometry().width));
  fill_normal(setup.pattern_seed(), 1, 0, column);
  const double pixel_k = setup.number("pixel_k");
  const double column_k = setup.number("column_k");
  for (std::size_t i = 0; i < offset_k.size(); ++i) {
    offset_k[i] = pixel_k * offset_k[i] + column_k * column[i % column.size()];
  }
  return [offset_k = std::move(offset_k)](const FrameInstant&, int row, std::span<double> kelvin) {
    const auto own = row_of(offset_k, row, kelvin.size());
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += own[x];
  };
}

double phase_of(std::uint64_t seed) { return SplitMix(seed).between(0.0, 1.0); }  // in turns

auto drift_gain(const EffectSetup& setup) {
  return [amplitude = setup.number("amplitude"), period_s = setup.number("period_s"),
          reference_k = setup.number("reference_k"),
          phase = phase_of(setup.noise_seed())](const FrameInstant& frame, int, std::span<double> kelvin) {
    const double excess = amplitude * std::sin(2.0 * std::numbers::pi * (frame.t_s / period_s + phase));
    for (double& k : kelvin) k += excess * (k - reference_k);
  };
}

// Part of each pixel's signal remains on the line when the next column is read.
auto smear_columns(const EffectSetup& setup) {
  return [share = setup.number("share")](const FrameInstant&, int, std::span<double> kelvin) {
    for (std::size_t x = kelvin.size(); x-- > 1;) kelvin[x] += share * (kelvin[x - 1] - kelvin[x]);
  };
}

// The bias heats the pixels while the frame is read, row after row.
auto heat_rows(const EffectSetup& setup) {
  return [amplitude_k = setup.number("amplitude_k"), height = static_cast<double>(setup.geometry().height)](
             const FrameInstant&, int row, std::span<double> kelvin) {
    const double offset_k = -amplitude_k * std::expm1(-3.0 * row / height);
    for (double& k : kelvin) k += offset_k;
  };
}

// The package warms up slowly over all captures of a session, and offsets drift with it.
auto drift_offsets(const EffectSetup& setup) {
  constexpr double kPeriods = 4.0;  // time_s is about a quarter of the sine's period
  std::vector<double> answer = normal_plane(setup.pattern_seed(), setup.geometry());  // per pixel, 1 on average
  for (double& value : answer) value = 1.0 + setup.number("spread") * value;
  const bool sine = setup.form("sine");
  const double phase = SplitMix(setup.pattern_seed()).between(0.0, 2.0 * std::numbers::pi);
  return [=, answer = std::move(answer), amplitude_k = setup.number("amplitude_k"), time_s = setup.number("time_s")](
             const FrameInstant& frame, int row, std::span<double> kelvin) {
    const double at = frame.session_s / time_s;
    const double offset_k =
        amplitude_k *
        (sine ? std::sin(2.0 * std::numbers::pi * at / kPeriods + phase) - std::sin(phase) : -std::expm1(-at));
    const auto own = row_of(answer, row, kelvin.size());
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += offset_k * own[x];
  };
}

// Mains hum with opposite signs in the two halves of the read-out.
auto hum(const EffectSetup& setup) {
  return [amplitude_k = setup.number("amplitude_k"), frequency_hz = setup.number("frequency_hz"),
          phase = phase_of(setup.noise_seed()),
          height = setup.geometry().height](const FrameInstant& frame, int row, std::span<double> kelvin) {
    const double upper_k = amplitude_k * std::sin(2.0 * std::numbers::pi * (frequency_hz * frame.t_s + phase));
    for (double& k : kelvin) k += 2 * row < height ? upper_k : -upper_k;
  };
}

template <bool kAbove>
auto cut(const EffectSetup& setup) {
  const auto [low_k, high_k] = setup.extremes();
  double level_k = setup.number("level_k");
  const double inside_k = kCut * (high_k - low_k);
  if (std::isnan(level_k) && high_k > low_k) level_k = kAbove ? high_k - inside_k : low_k + inside_k;
  return [level_k](const FrameInstant&, int, std::span<double> kelvin) {
    if (std::isnan(level_k)) return;
    for (double& k : kelvin) k = kAbove ? std::min(k, level_k) : std::max(k, level_k);
  };
}

}  // namespace

std::vector<EffectType> readout_effects() {
  return {
      EffectType(
          "fpn_gain", Stage::kReadout, Order::kGain, "a fixed pattern of gains",
          {{"rms", "", 0.006, {0.0, 0.2}, {{0.003, 0.01}}, "of the pixels' gains about 1"},
           {"reference_k", "K", 300.0, {200.0, 400.0}, {}, "the temperature at which the gain makes no difference"}},
          {}, hooked(fixed_gains)),
      EffectType("fpn_offset", Stage::kReadout, Order::kOffset, "a fixed pattern of offsets, of pixels and of columns",
                 {{"pixel_k", "K", 0.03, {0.0, 5.0}, {{0.015, 0.05}}, "rms of the pixels'"},
                  {"column_k", "K", 0.015, {0.0, 5.0}, {{0.008, 0.025}}, "rms of the columns'"}},
                 {}, hooked(fixed_offsets)),
      outside_catalogue(EffectType(
          "gain_drift", Stage::kReadout, Order::kGain,
          "the gain of all pixels goes up and down, slowly, from an unknown phase on",
          {{"amplitude", "", 0.01, {0.0, 0.5}, {{0.005, 0.02}}, "of the gain about 1"},
           {"period_s", "s", 2.5, {0.05, 1e4}, {}, "of one up and down"},
           {"reference_k", "K", 295.0, {200.0, 400.0}, {}, "the temperature at which the gain makes no difference"}},
          {}, hooked(drift_gain))),
      outside_catalogue(EffectType(
          "column_crosstalk", Stage::kReadout, Order::kGain, "each pixel shows a part of the one to its left",
          {{"share", "", 0.04, {0.0, 0.9}, {{0.02, 0.06}}, "of the pixel to the left"}}, {}, hooked(smear_columns))),
      EffectType("self_heating", Stage::kReadout, Order::kOffset,
                 "an offset that grows within the frame: amplitude * (1 - exp(-3 row / height))",
                 {{"amplitude_k", "K", 0.05, {-5.0, 5.0}, {{0.01, 0.1}}, "of the last rows, nearly"}}, {},
                 hooked(heat_rows)),
      EffectType("drift", Stage::kPackage, Order::kOffset,
                 "offsets move with the package's temperature: amplitude * (1 - exp(-t / time)) of the session's time, "
                 "or a sine of period 4 * time",
                 {{"amplitude_k", "K", 0.09, {-5.0, 5.0}, {{0.03, 0.15}}, "at the end, or of the sine"},
                  {"time_s", "s", 10.0, {0.1, 1e4}, {{3.0, 30.0}}, "time constant"},
                  {"spread", "", 0.3, {0.0, 2.0}, {}, "rms of the pixels' amplitudes, of their mean"}},
                 {"warming", "sine"}, hooked(drift_offsets)),
      outside_catalogue(EffectType("mains_hum", Stage::kReadout, Order::kOffset,
                                   "a sine added to the upper half of the rows and taken from the lower",
                                   {{"amplitude_k", "K", 0.06, {0.0, 5.0}, {{0.03, 0.1}}, "of the sine"},
                                    {"frequency_hz", "Hz", 50.0, {0.1, 1000.0}, {}, "of the mains"}},
                                   {}, hooked(hum))),
      EffectType("saturation", Stage::kReadout, Order::kLimit, "values are cut off above a level",
                 {{"level_k",
                   "K",
                   kScenes,
                   {1.0, 2000.0},
                   {},
                   "highest value; by default 85 % of the way from the scene's coldest to its hottest"}},
                 {}, hooked(cut<true>)),
      outside_catalogue(
          EffectType("clipped_range", Stage::kReadout, Order::kLimit, "values are cut off below a level",
                     {{"level_k",
                       "K",
                       kScenes,
                       {1.0, 2000.0},
                       {},
                       "lowest value; by default 15 % of the way from the scene's coldest to its hottest"}},
                     {}, hooked(cut<false>))),
  };
}

}  // namespace bolo::sim
