// Interface of effects. An effect overrides the hooks it needs; the camera calls them in the order of Order.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "src/sim/effect.hpp"
#include "src/sim/field.hpp"
#include "src/sim/random.hpp"
#include "src/sim/simulator.hpp"

namespace bolo::sim {

// Place in the signal chain. Hooks run in this order, then by name. White noise is added between kOffset and kDefect.
enum class Order {
  kEmission,    // radiation of the scene
  kRadiance,    // from temperature to the detector's input
  kOptics,      // blur, ghosts, shading
  kPixel,       // time constant, conduction, low-frequency noise
  kGain,        // read-out, proportional to the signal
  kOffset,      // read-out, added
  kDefect,      // dead pixels
  kLimit,       // the converter's range
  kFilter,      // firmware: filters over frames
  kCorrection,  // firmware: offset corrections
  kOutput,      // firmware: number format
  kTransport,   // frame loss and times
};

// The pixel array and its read-out, initially nominal; effects change it before the first frame.
struct CameraModel {
  Geometry geometry;
  double period_s = 0.005;
  std::vector<double> tau_s;   // per pixel
  double falling_scale = 1.0;  // of tau while the pixel cools
  double slow_share = 0.0;     // of the response, with slow_tau_s
  double slow_tau_s = 0.0;
  double coupling = 0.0;            // conduction to each neighbour, in units of the pixel's own
  int neighbours = 4;               // or 8
  std::vector<double> row_delay_s;  // read time of each row, relative to the frame's time
  double window_s = 0.0;            // integration time before the read-out; 0: instantaneous
  bool radiance = false;            // pixels integrate band radiance, the read-out shows temperature
  double noise_scale = 1.0;
  double noise_degrees = 0.0;  // of Student's t distribution; 0: normal
  int warm_up_frames = 0;      // frames before the first one that affect the firmware's state
  double look_ahead_s = 0.0;   // maximum |shift_s()|
};

// The current frame. The index counts the camera's frames from 0; negative during the firmware's warm-up.
struct FrameInstant {
  std::int64_t index = 0;
  double t_s = 0.0;        // time in the capture
  double session_s = 0.0;  // time since power-on
};

// A grid of points spaced one pixel apart, from (column, row) to the right and down. The first column may lie between
// two pixels, and points may lie outside the frame.
struct Patch {
  double column = 0.0;
  int row = 0;
  int width = 0;
  int height = 0;
  std::size_t points() const noexcept { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
};

// The signal arriving at one band of rows; has its own work buffers.
class View {
 public:
  virtual ~View() = default;
  // The signal at `patch`, row-major, at t. Thread: one at a time.
  virtual void draw(double t_s, const Patch& patch, std::span<float> out) = 0;
  // Factor by which its time steps may exceed those of the bare field, because optics smooth jumps.
  virtual double patience() const { return 1.0; }
  // This view after a blur, if known in closed form; otherwise nullptr. Thread: setup.
  virtual std::unique_ptr<View> blurred(const Blur& /*blur*/) const { return nullptr; }
};

// A view that maps each point independently: change(value, x, y).
template <typename Change>
class PointView final : public View {
 public:
  PointView(std::unique_ptr<View> inner, Change change) : inner_(std::move(inner)), change_(std::move(change)) {}
  void draw(double t_s, const Patch& patch, std::span<float> out) override {
    inner_->draw(t_s, patch, out);
    std::size_t i = 0;
    for (int y = 0; y < patch.height; ++y) {
      for (int x = 0; x < patch.width; ++x, ++i) out[i] = change_(out[i], patch.column + x, patch.row + y);
    }
  }
  double patience() const override { return inner_->patience(); }

 private:
  std::unique_ptr<View> inner_;
  Change change_;
};

template <typename Change>
std::unique_ptr<View> point_view(std::unique_ptr<View> inner, Change change) {
  return std::make_unique<PointView<Change>>(std::move(inner), std::move(change));
}

class Effect {
 public:
  virtual ~Effect() = default;

  // Changes the camera. Thread: setup.
  virtual void configure(CameraModel&) {}

  // Inserts itself between the scene and the pixels. Called once per band of rows. Thread: setup.
  virtual std::unique_ptr<View> filter_view(std::unique_ptr<View> inner, const CameraModel&) const { return inner; }

  // Delay of the frame relative to its nominal time, s. Called once per frame, in order. Thread: one at a time.
  virtual double shift_s(std::int64_t, double) { return 0.0; }

  // Called once per frame, in order, before its rows. Thread: one at a time.
  virtual void begin(const FrameInstant&) {}

  // Changes the values of a row, K. Thread: any, different rows concurrently.
  virtual void row(const FrameInstant&, int, std::span<double>) noexcept {}

  // For the k-th sent frame: 1 if a frame before it is lost, -1 if it repeats the previous one. Called once for each k,
  // in order. Thread: one at a time.
  virtual int frames_lost(std::uint64_t) { return 0; }
};

class EffectSetup {
 public:
  EffectSetup(const EffectDescription& description, const EffectSpec& spec, const CameraSettings& settings,
              Extremes extremes);

  double number(std::string_view key) const;  // given or standard
  bool form(std::string_view name) const;     // given or standard
  const CameraSettings& settings() const noexcept { return settings_; }
  const Geometry& geometry() const noexcept { return settings_.geometry; }
  double period_s() const noexcept { return 1.0 / settings_.rate_hz; }
  Extremes extremes() const noexcept { return extremes_; }
  std::uint64_t pattern_seed() const noexcept { return pattern_seed_; }  // for properties of the camera
  std::uint64_t noise_seed() const noexcept { return noise_seed_; }      // for properties of one capture

 private:
  const EffectDescription& description_;
  const EffectSpec& spec_;
  const CameraSettings& settings_;
  Extremes extremes_;
  std::uint64_t pattern_seed_;
  std::uint64_t noise_seed_;
};

// `make` is a maker() or a hooked().
struct EffectType {
  EffectDescription description;
  Order order;
  std::function<std::unique_ptr<Effect>(const EffectSetup&)> make;

  EffectType(std::string_view name, Stage stage, Order place, std::string_view about, std::vector<Parameter> parameters,
             std::vector<std::string_view> forms, std::function<std::unique_ptr<Effect>(const EffectSetup&)> from)
      : description{name, stage, true, about, std::move(parameters), std::move(forms)},
        order(place),
        make(std::move(from)) {}
};

// Marks an effect that no diagnosis identifies.
inline EffectType outside_catalogue(EffectType type) {
  type.description.in_catalogue = false;
  return type;
}

// All types by name, from the files in src/sim/effects. Thread: any.
const std::vector<EffectType>& effect_types();

// An effect and its place; make_effects() sorts by place. The settings must be checked. Thread: setup.
struct PlacedEffect {
  Order order = Order::kOffset;
  std::unique_ptr<Effect> effect;
};
std::vector<PlacedEffect> make_effects(const CameraSettings& settings, Extremes extremes);

template <typename T>
auto maker() {
  return [](const EffectSetup& setup) -> std::unique_ptr<Effect> { return std::make_unique<T>(setup); };
}

// An effect with a single hook: a function like configure(), filter_view(), row(), shift_s() or frames_lost().
template <typename Hook>
class HookEffect final : public Effect {
  static constexpr bool kConfigures = std::is_invocable_v<Hook&, CameraModel&>;
  static constexpr bool kFiltersView = std::is_invocable_v<const Hook&, std::unique_ptr<View>, const CameraModel&>;
  static constexpr bool kRow = std::is_invocable_v<Hook&, const FrameInstant&, int, std::span<double>>;
  static constexpr bool kShifts = std::is_invocable_v<Hook&, std::int64_t, double>;
  static constexpr bool kLoses = std::is_invocable_v<Hook&, std::uint64_t>;
  static_assert(kConfigures || kFiltersView || kRow || kShifts || kLoses, "takes what none of the hooks gets");

 public:
  explicit HookEffect(Hook hook) : hook_(std::move(hook)) {}
  void configure(CameraModel& model) override {
    if constexpr (kConfigures) hook_(model);
  }
  std::unique_ptr<View> filter_view(std::unique_ptr<View> inner, const CameraModel& model) const override {
    if constexpr (kFiltersView) inner = hook_(std::move(inner), model);
    return inner;
  }
  void row(const FrameInstant& frame, int row, std::span<double> kelvin) noexcept override {
    if constexpr (kRow) hook_(frame, row, kelvin);
  }
  double shift_s(std::int64_t frame, double nominal_s) override {
    if constexpr (kShifts) return hook_(frame, nominal_s);
    return Effect::shift_s(frame, nominal_s);
  }
  int frames_lost(std::uint64_t sent) override {
    if constexpr (kLoses) return hook_(sent);
    return Effect::frames_lost(sent);
  }

 private:
  Hook hook_;
};

// Factory of an effect from the hook returned by `hook_of(setup)`.
template <typename HookOf>
auto hooked(HookOf hook_of) {
  return [hook_of](const EffectSetup& setup) -> std::unique_ptr<Effect> {
    return std::make_unique<HookEffect<decltype(hook_of(setup))>>(hook_of(setup));
  };
}

// One row of a plane of the frame. Thread: any.
template <typename Plane>
auto row_of(Plane& plane, int row, std::size_t width) noexcept {
  return std::span(plane).subspan(static_cast<std::size_t>(row) * width, width);
}

}  // namespace bolo::sim
