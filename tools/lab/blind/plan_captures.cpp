#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "tools/lab/blind/captures.hpp"

namespace bolo::tools::blind {
namespace {

constexpr double kPeriodS = 0.005;
constexpr double kShutterK = 300.0;
constexpr double kHotK = 325.0;
constexpr double kChopperColdK = 295.0;
constexpr std::array<double, 2> kChopperLevelsK{305.0, 320.0};
constexpr std::array<double, 5> kPulsesS{0.012, 0.030, 0.060, 0.120, 0.300};
constexpr double kGapS = 0.0837;  // no multiple of a frame: pulses begin at many phases of it
constexpr double kBarsColdK = 290.0;
constexpr double kBarsHotK = 315.0;

struct Length {
  const char* file;
  int frames;
};
constexpr std::array<Length, 6> kCaptures{{{"capture-1.h5", 380},
                                           {"capture-2.h5", 240},
                                           {"capture-3.h5", 400},
                                           {"capture-4.h5", 340},
                                           {"capture-5.h5", 340},
                                           {"capture-6.h5", 300}}};

bool is_moment(const sim::EffectSpec& effect) { return effect.name == "nuc_freeze" || effect.name == "offset_jump"; }

// Every length at every height, as many as end within the capture.
capture::Chopper chopper(double duration_s) {
  capture::Chopper out;
  out.cold_k = kChopperColdK;
  double on_s = kGapS;
  for (const double level_k : kChopperLevelsK) {
    for (const double pulse_s : kPulsesS) {
      if (on_s + pulse_s > duration_s) return out;
      out.on_s.push_back(on_s);
      out.off_s.push_back(on_s + pulse_s);
      out.level_k.push_back(level_k);
      on_s += pulse_s + kGapS;
    }
  }
  return out;
}

capture::BarTarget bars(const Geometry& geometry, double velocity_px_s) {
  const double period_px = geometry.width < 64 ? 20.0 : 40.0;
  return {kBarsColdK, kBarsHotK, period_px, period_px / 2.0, 0.25, velocity_px_s};
}

capture::Stimulus stimulus_of(std::size_t i, const Geometry& geometry, double duration_s) {
  switch (i) {
    case 0:
      return capture::Uniform{kShutterK};
    case 1:
      return capture::Uniform{kHotK};
    case 2:
      return chopper(duration_s);
    case 3:
      return bars(geometry, 70.0);
    case 4:
      return bars(geometry, -320.0);
    default:
      return bars(geometry, 0.0);
  }
}

// What is the same in all captures of a session: one target, one room.
struct Bench {
  bool imperfect = false;
  double edge_px = 0.0;
  double reflection = 0.0;
};

Bench draw_bench(bool imperfect, Dice& dice) {
  return imperfect ? Bench{true, dice.between(0.0, 0.3), dice.between(0.0, 0.01)} : Bench{};
}

// Where the stimulus truly starts is never known; the rest of its errors only of an imperfect bench.
sim::StimulusError draw_faults(const capture::Stimulus& stimulus, const Bench& bench, Dice& dice) {
  sim::StimulusError faults;
  const bool is_chopper = std::holds_alternative<capture::Chopper>(stimulus);
  const auto* const target = std::get_if<capture::BarTarget>(&stimulus);
  if (is_chopper) faults.start_s = dice.between(-0.005, 0.005);
  if (target != nullptr) faults.phase = dice.unit();
  if (!bench.imperfect) return faults;
  constexpr double kLeastK = 0.1;
  constexpr double kMostK = 1.0;
  faults.level_k = dice.signed_between(kLeastK, kMostK);
  faults.reflection = bench.reflection;
  if (is_chopper) faults.sweep_s = dice.between(0.0, 0.004);
  if (is_chopper) faults.level2_k = dice.signed_between(kLeastK, kMostK);
  if (is_chopper || target != nullptr) faults.cold_k = dice.signed_between(kLeastK, kMostK);
  if (target == nullptr) return faults;
  faults.edge_px = bench.edge_px;
  if (target->velocity_px_s == 0.0) return faults;
  faults.velocity = dice.signed_between(0.0, 0.01);
  faults.uneven = dice.between(0.0, 0.01);
  faults.uneven_period_s = dice.between(1.0, 3.0);  // slow: a capture is about one swing
  faults.uneven_phase = dice.unit();
  return faults;
}

void add_effect(std::vector<CapturePlan>& plans, const sim::EffectSpec& effect, Dice& dice) {
  if (!is_moment(effect)) {
    for (CapturePlan& plan : plans) plan.effects.push_back(effect);
    return;
  }
  // Often the same one twice: then it happens once.
  const std::set<std::size_t> where{dice.below(plans.size()), dice.below(plans.size())};
  for (const std::size_t i : where) {
    sim::EffectSpec placed = effect;
    placed.values["at_s"] = dice.between(0.2, 0.55) * static_cast<double>(plans[i].frames) * kPeriodS;
    plans[i].effects.push_back(std::move(placed));
  }
}

}  // namespace

void place_in_scene(sim::EffectSpec& effect, Dice& dice) {
  const double cut = dice.between(0.05, 0.25);
  if (effect.name == "saturation") {
    effect.values["level_k"] = kChopperLevelsK[1] - cut * (kChopperLevelsK[1] - kChopperColdK);
  }
  if (effect.name == "clipped_range") effect.values["level_k"] = kBarsColdK + cut * (kBarsHotK - kBarsColdK);
}

std::vector<CapturePlan> plan_captures(const DrawOptions& options, const std::vector<sim::EffectSpec>& effects,
                                       Dice& dice) {
  std::vector<CapturePlan> plans;
  const Bench bench = draw_bench(options.imperfect, dice);
  double start_s = 0.0;
  for (std::size_t i = 0; i < kCaptures.size(); ++i) {
    CapturePlan plan;
    plan.file = kCaptures[i].file;
    plan.frames = static_cast<std::size_t>(std::max(20.0, std::round(kCaptures[i].frames * options.frames_scale)));
    const double duration_s = static_cast<double>(plan.frames) * kPeriodS;
    plan.stimulus = stimulus_of(i, options.geometry, duration_s);
    plan.session_start_s = start_s;
    plan.noise_seed = dice.word() >> 1U;
    plan.faults = draw_faults(plan.stimulus, bench, dice);
    start_s += duration_s + dice.between(1.0, 3.0);
    plans.push_back(std::move(plan));
  }
  for (const sim::EffectSpec& effect : effects) add_effect(plans, effect, dice);
  return plans;
}

}  // namespace bolo::tools::blind
