// What an effect is made of. An effect overrides the hooks it needs; the camera calls them in the order of Order.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "src/sim/effect.hpp"
#include "src/sim/random.hpp"
#include "src/sim/simulator.hpp"
#include "src/sim/view.hpp"

namespace bolo::sim {

// Where in the signal's way an effect acts. Hooks run in this order, within one place by name. White noise is added
// between kOffset and kDefect.
enum class Order {
  kEmission,    // what the scene sends out
  kRadiance,    // from temperature to what the detector answers to
  kOptics,      // blur, ghosts, shading
  kPixel,       // the pixel's own time constant, conduction, low-frequency noise
  kGain,        // read-out, proportional to the signal
  kOffset,      // read-out, added
  kDefect,      // pixels that do not answer
  kLimit,       // the converter's range
  kFilter,      // firmware: filters over frames
  kCorrection,  // firmware: offset corrections
  kOutput,      // firmware: number format
  kTransport,   // frames on their way
};

// One pixel array and its read-out, set to the nominal camera; effects change it before the first frame.
struct CameraModel {
  Geometry geometry;
  double period_s = 0.005;
  std::vector<double> tau_s;   // each pixel's
  double falling_scale = 1.0;  // of tau while the pixel cools
  double slow_share = 0.0;     // of the answer, with slow_tau_s
  double slow_tau_s = 0.0;
  double coupling = 0.0;            // conduction to each neighbour, in units of the pixel's own
  int neighbours = 4;               // or 8
  std::vector<double> row_delay_s;  // when each row is read, from the frame's time
  double window_s = 0.0;            // a row is the mean over so long before it is read; 0: an instant
  bool radiance = false;            // pixels integrate band radiance, the read-out shows temperature
  double noise_scale = 1.0;
  double noise_degrees = 0.0;  // of Student's t; 0: normal
  int warm_up_frames = 0;      // frames before the first that the firmware remembers
  double look_ahead_s = 0.0;   // the most that shift_s() may give, either way
};

// What an effect may know of the frame in work. The index counts the frames the camera takes, from 0; it is negative
// while the firmware warms up.
struct FrameInstant {
  std::int64_t index = 0;
  double t_s = 0.0;        // when it is taken: the capture's time
  double session_s = 0.0;  // the same since the camera was switched on
};

class Effect {
 public:
  virtual ~Effect() = default;

  // Changes the camera. Thread: setup.
  virtual void configure(CameraModel&) {}

  // Puts itself between the scene and the pixels. Called once for each band of rows. Thread: setup.
  virtual std::unique_ptr<View> look(std::unique_ptr<View> inner, const CameraModel&) const { return inner; }

  // How much later than nominal the frame is taken, s. Called once a frame, in order. Thread: one at a time.
  virtual double shift_s(std::int64_t, double) { return 0.0; }

  // Once a frame, in order, before its rows. Thread: one at a time.
  virtual void begin(const FrameInstant&) {}

  // Changes what a row shows, K. Thread: any, different rows at once.
  virtual void row(const FrameInstant&, int, std::span<double>) noexcept {}

  // For the k-th frame sent: 1 when a frame before it is lost, -1 when it is the one before once more. Called once for
  // each k, in order. Thread: one at a time.
  virtual int frames_lost(std::uint64_t) { return 0; }
};

// What an effect is made from.
class EffectSetup {
 public:
  EffectSetup(const EffectDescription& description, const EffectSpec& spec, const CameraSettings& settings,
              Extremes extremes);

  double number(std::string_view key) const;  // as given, or standard
  bool form(std::string_view name) const;     // as given, or standard
  const CameraSettings& settings() const noexcept { return settings_; }
  const Geometry& geometry() const noexcept { return settings_.geometry; }
  double period_s() const noexcept { return 1.0 / settings_.rate_hz; }
  Extremes extremes() const noexcept { return extremes_; }
  std::uint64_t pattern_seed() const noexcept { return pattern_seed_; }  // of what belongs to the camera
  std::uint64_t noise_seed() const noexcept { return noise_seed_; }      // of what is new in every capture

 private:
  const EffectDescription& description_;
  const EffectSpec& spec_;
  const CameraSettings& settings_;
  Extremes extremes_;
  std::uint64_t pattern_seed_;
  std::uint64_t noise_seed_;
};

struct EffectType {
  EffectDescription description;
  Order order = Order::kOffset;
  std::function<std::unique_ptr<Effect>(const EffectSetup&)> make;
};

// All types by name: src/sim/effects/NAME.cpp defines `EffectType effects::NAME()`. Thread: any.
const std::vector<EffectType>& effect_types();

// The effects in the order of their places. `specs` are checked. Thread: setup.
struct PlacedEffect {
  Order order = Order::kOffset;
  std::unique_ptr<Effect> effect;
};
std::vector<PlacedEffect> make_effects(const CameraSettings& settings, Extremes extremes);

template <typename T>
auto maker() {
  return [](const EffectSetup& setup) -> std::unique_ptr<Effect> { return std::make_unique<T>(setup); };
}

}  // namespace bolo::sim
