// The pixel: its time constants, its neighbours, and its read-out time.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {
namespace {

// Relative spread of tau, mean 0, variance 1 over the frame.
std::vector<double> spread_of(const EffectSetup& setup) {
  const std::uint64_t seed = setup.pattern_seed();
  if (setup.form("gradient")) return gradient_plane(seed, setup.geometry());
  if (setup.form("smooth")) return smooth_plane(seed, setup.geometry());
  std::vector<double> white = standardised(normal_plane(key(seed, 1), setup.geometry()));
  if (setup.form("white")) return white;
  const std::vector<double> smooth = smooth_plane(seed, setup.geometry());
  for (std::size_t i = 0; i < white.size(); ++i) white[i] = (white[i] + smooth[i]) * std::sqrt(0.5);
  return standardised(std::move(white));
}

auto scale_tau(const EffectSetup& setup) {
  return [scale = setup.number("scale")](CameraModel& model) {
    for (double& tau_s : model.tau_s) tau_s *= scale;
  };
}

auto spread_tau(const EffectSetup& setup) {
  std::vector<double> spread = spread_of(setup);
  for (double& value : spread) value *= setup.number("rms");
  return [spread = std::move(spread)](CameraModel& model) {
    constexpr double kLeast = 0.2;  // lower limit of tau for a wide spread
    for (std::size_t i = 0; i < spread.size(); ++i) model.tau_s[i] *= std::max(kLeast, 1.0 + spread[i]);
  };
}

auto scale_falling_tau(const EffectSetup& setup) {
  return [scale = setup.number("scale")](CameraModel& model) { model.falling_scale = scale; };
}

auto add_slow_pole(const EffectSetup& setup) {
  return [share = setup.number("share"), slow_tau_s = setup.number("slow_tau_s")](CameraModel& model) {
    model.slow_share = share;
    model.slow_tau_s = slow_tau_s;
  };
}

auto conduct(const EffectSetup& setup) {
  return [coupling = setup.number("coupling"), neighbours = setup.number("neighbours")](CameraModel& model) {
    model.coupling = coupling;
    model.neighbours = neighbours >= 6.0 ? 8 : 4;
  };
}

auto delay_rows(const EffectSetup& setup) {
  return [delay_s = setup.number("row_delay_s"), halves = setup.form("halves")](CameraModel& model) {
    const int height = model.geometry.height;
    const int turn = halves ? (height + 1) / 2 : height;
    for (int row = 0; row < height; ++row) model.row_delay_s[static_cast<std::size_t>(row)] += delay_s * (row % turn);
  };
}

auto delay_to_the_middle(const EffectSetup& setup) {
  return [delay_s = setup.number("row_delay_s")](CameraModel& model) {
    const int height = model.geometry.height;
    for (int row = 0; row < height; ++row) {
      model.row_delay_s[static_cast<std::size_t>(row)] += delay_s * std::min(row, height - 1 - row);
    }
  };
}

auto average_over_window(const EffectSetup& setup) {
  return [window_s = setup.number("window_s")](CameraModel& model) { model.window_s = window_s; };
}

}  // namespace

std::vector<EffectType> pixel_effects() {
  return {
      EffectType("tau_global", Stage::kPixel, Order::kPixel, "the time constant of every pixel is scaled",
                 {{"scale", "", 1.1, {0.5, 2.0}, {{0.85, 0.95}, {1.05, 1.2}}, "of the stated time constant"}}, {},
                 hooked(scale_tau)),
      EffectType("tau_spread", Stage::kPixel, Order::kPixel,
                 "time constants differ from pixel to pixel; mixed: a white and a smooth pattern of one variance",
                 {{"rms", "", 0.04, {0.0, 0.3}, {{0.02, 0.06}}, "of tau, as a fraction of its mean"}},
                 {"mixed", "white", "smooth", "gradient"}, hooked(spread_tau)),
      outside_catalogue(EffectType(
          "tau_asymmetry", Stage::kPixel, Order::kPixel, "the time constant is another one while a pixel cools",
          {{"scale", "", 1.25, {0.5, 2.0}, {{1.15, 1.4}}, "falling tau / rising tau"}}, {}, hooked(scale_falling_tau))),
      EffectType("slow_pole", Stage::kPixel, Order::kPixel,
                 "the answer is (1 - share) / (1 + s tau) + share / (1 + s slow_tau)",
                 {{"share", "", 0.02, {0.0, 0.3}, {{0.01, 0.03}}, "of the answer that is slow"},
                  {"slow_tau_s", "s", 0.15, {0.02, 2.0}, {{0.06, 0.4}}, "its time constant"}},
                 {}, hooked(add_slow_pole)),
      EffectType(
          "crosstalk", Stage::kPixel, Order::kPixel,
          "heat flows between neighbours: tau dT/dt = x - T - coupling * sum (T - T_n)",
          {{"coupling", "", 0.04, {0.0, 1.0}, {{0.02, 0.06}}, "conductance to each neighbour, of the pixel's own"},
           {"neighbours", "", 4.0, {4.0, 8.0}, {}, "4 or 8"}},
          {}, hooked(conduct)),
      EffectType("row_delay", Stage::kReadout, Order::kPixel,
                 "row r is read r delays after row 0; halves: two halves are read at once",
                 {{"row_delay_s", "s", 2.8e-5, {-1e-4, 1e-4}, {{1e-5, 4.1e-5}}, "from one sensor row to the next"}},
                 {"rolling", "halves"}, hooked(delay_rows)),
      outside_catalogue(
          EffectType("split_readout", Stage::kReadout, Order::kPixel,
                     "two halves are read at once, in opposite directions, and meet in the middle",
                     {{"row_delay_s", "s", 2.8e-5, {-1e-4, 1e-4}, {{1e-5, 4.1e-5}}, "from one sensor row to the next"}},
                     {}, hooked(delay_to_the_middle))),
      EffectType("integration_window", Stage::kReadout, Order::kPixel,
                 "a frame is the mean of what the pixel shows over the window that ends at its time",
                 {{"window_s", "s", 0.002, {1e-5, 0.1}, {{0.0005, 0.005}}, "length"}}, {}, hooked(average_over_window)),
  };
}

}  // namespace bolo::sim
