#include "tools/lab/blind/reality.hpp"

namespace bolo::tools::blind::second {
namespace {

struct Number {
  const char* key;
  double low;
  double high;
  bool signed_too = false;
};

// An effect in one of its forms; the first entry of a name is its standard form.
struct Entry {
  const char* name;
  const char* form;
  bool in_catalogue;
  std::vector<Number> numbers;
};

const std::vector<Entry>& entries() {
  static const std::vector<Entry> all{
      {"clock_skew", "", true, {{"skew", 1.5e-4, 1e-3, true}}},
      {"coarse_quantisation", "", true, {{"step_k", 0.1, 0.1}}},
      {"crosstalk", "", true, {{"coupling", 0.02, 0.06}}},
      {"crosstalk", "eight", true, {{"coupling", 0.015, 0.04}}},
      {"dead_pixels", "", true, {{"fraction", 0.003, 0.01}}},
      {"dead_pixels", "silent", true, {{"fraction", 0.005, 0.015}}},
      {"drift", "", true, {{"amplitude_k", 0.05, 0.15, true}, {"time_s", 6.0, 20.0}, {"spread", 0.2, 0.35}}},
      {"emissivity", "", true, {{"emissivity", 0.93, 0.985}, {"surroundings_k", 290.0, 300.0}}},
      {"flicker", "", true, {{"sigma_k", 0.005, 0.015}, {"correlation", 0.0, 0.3}}},
      {"flicker", "slow", true, {{"sigma_k", 0.006, 0.015}, {"correlation", 0.7, 0.9}}},
      {"fpn_gain", "", true, {{"rms", 0.003, 0.01}}},
      {"fpn_offset", "", true, {{"pixel_k", 0.015, 0.05}, {"column_k", 0.008, 0.025}}},
      {"frame_loss", "", true, {{"per_thousand", 4.0, 9.0}}},
      {"frame_loss", "burst", true, {{"per_thousand", 5.0, 5.0}}},
      {"heavy_tail", "", true, {{"degrees", 3.0, 6.0}}},
      {"iir", "", true, {{"alpha", 0.6, 0.9}}},
      {"integration_window", "", true, {{"window_s", 1e-3, 4e-3}}},
      {"jitter", "", true, {{"rms_s", 2e-4, 8e-4}}},
      {"noise_level", "", true, {{"scale", 1.12, 1.5}}},
      {"nuc_freeze", "", true, {{"freeze_frames", 50.0, 100.0}, {"offset_k", 0.05, 0.08}}},
      {"offset_jump", "", true, {{"jump_k", 0.1, 3.0, true}}},
      {"one_over_f", "", true, {{"corner_hz", 1.5, 6.0}, {"exponent", 0.95, 1.05}}},
      {"one_over_f", "steep", true, {{"corner_hz", 1.5, 4.0}, {"exponent", 1.4, 1.4}}},
      {"one_over_f", "flat", true, {{"corner_hz", 2.0, 6.0}, {"exponent", 0.7, 0.7}}},
      {"optical_psf", "", true, {{"sigma_px", 0.4, 1.1}}},
      {"optical_psf", "disc", true, {{"sigma_px", 0.5, 1.0}}},
      {"radiometric_nonlinearity", "", true, {}},
      {"row_delay", "", true, {{"row_delay_s", 1e-5, 4.1e-5, true}}},
      {"rts", "", true, {{"fraction", 0.005, 0.02}, {"step_k", 0.12, 0.3}, {"rate_hz", 1.5, 6.0}}},
      {"saturation", "", true, {{"level_k", 315.0, 319.0}}},
      {"self_heating", "", true, {{"amplitude_k", 0.03, 0.12}}},
      {"slow_pole", "", true, {{"share", 0.01, 0.03}, {"slow_tau_s", 0.06, 0.4}}},
      {"stripes", "", true, {{"column_k", 0.006, 0.02}, {"row_k", 0.0, 0.015}}},
      {"tau_global", "", true, {{"scale", 0.85, 0.95}}},
      {"tau_global", "slower", true, {{"scale", 1.05, 1.2}}},
      {"tau_spread", "", true, {{"rms", 0.02, 0.06}}},
      {"vignetting", "", true, {{"corner_loss", 0.005, 0.02}, {"centre_x", -0.1, 0.1}, {"centre_y", -0.1, 0.1}}},
      {"vignetting", "aside", true, {{"corner_loss", 0.01, 0.02}, {"centre_x", 0.2, 0.3}, {"centre_y", -0.3, -0.2}}},
      {"clipped_range", "", false, {{"level_k", 290.0, 293.0}}},
      {"column_crosstalk", "", false, {{"share", 0.02, 0.06}}},
      {"gain_drift", "", false, {{"amplitude", 0.006, 0.015}}},
      {"lens_ghost", "", false, {{"share", 0.01, 0.03}}},
      {"mains_hum", "", false, {{"amplitude_k", 0.03, 0.08}}},
      {"split_readout", "", false, {{"row_delay_s", 2e-5, 4e-5}}},
      {"tau_asymmetry", "", false, {{"scale", 1.15, 1.35}}},
      {"torn_frames", "", false, {{"per_thousand", 4.0, 9.0}}},
  };
  return all;
}

std::vector<const Entry*> entries_of(Kind kind) {
  std::vector<const Entry*> out;
  for (const Entry& entry : entries()) {
    if (kind == Kind::kEffectFree || kind == Kind::kBench || entry.in_catalogue == (kind == Kind::kOutside)) continue;
    if ((kind == Kind::kForms) == (entry.form[0] != '\0')) out.push_back(&entry);
  }
  return out;
}

sim::EffectSpec drawn(const Entry& entry, Luck& lot) {
  sim::EffectSpec effect{entry.name, entry.form, {}};
  for (const Number& number : entry.numbers) {
    double value = lot.even(number.low, number.high);
    if (number.signed_too && lot.below(2) == 0) value = -value;
    effect.values[number.key] = value;
  }
  return effect;
}

capture::Chopper pulses(double duration_s) {
  capture::Chopper out;
  out.cold_k = 296.5;
  double on_s = 0.071;
  for (const double level_k : {321.0, 306.0}) {
    for (const double pulse_s : {0.28, 0.015, 0.11, 0.034, 0.066}) {
      if (on_s + pulse_s + 0.05 > duration_s) continue;
      out.on_s.push_back(on_s);
      out.off_s.push_back(on_s + pulse_s);
      out.level_k.push_back(level_k);
      on_s += pulse_s + 0.0791;
    }
  }
  return out;
}

capture::Stimulus stimulus_of(std::size_t i, double duration_s, double slant) {
  const auto bars = [slant](double velocity) { return capture::BarTarget{291.0, 314.0, 18.0, 8.5, slant, velocity}; };
  switch (i) {
    case 0:
      return capture::Uniform{299.0};
    case 1:
      return capture::Uniform{328.0};
    case 2:
      return pulses(duration_s);
    case 3:
      return bars(-82.0);
    case 4:
      return bars(297.0);
    default:
      return bars(0.0);
  }
}

// The bench's true errors: start phases always, others if imperfect.
void draw_bench(bool imperfect, double edge_px, CapturePlan& plan, Luck& lot) {
  auto& bench = plan.bench;
  const bool bars = std::holds_alternative<capture::BarTarget>(plan.stimulus);
  if (bars) bench["phase_px"] = lot.even(0.0, 18.0);
  if (std::holds_alternative<capture::Chopper>(plan.stimulus)) bench["start_s"] = lot.even(-0.006, 0.006);
  if (!imperfect) return;
  for (const char* level : {"level_0", "level_1", "level_2"}) bench[level] = lot.normal(0.35);
  if (bars) {
    bench["edge_px"] = edge_px;
    bench["velocity"] = lot.normal(0.005);
    bench["wobble_px"] = lot.even(0.0, 0.15);
  } else {
    bench["sweep_s"] = lot.even(-0.004, 0.004);
  }
}

std::vector<CapturePlan> plan_captures(const DrawOptions& options, const std::vector<sim::EffectSpec>& effects,
                                       Luck& lot) {
  constexpr std::array<int, 6> kFrames{360, 260, 410, 330, 330, 290};
  const double slant = lot.below(2) == 0 ? 0.21 : -0.27;
  const double edge_px = lot.even(0.0, 0.8);
  std::vector<CapturePlan> plans;
  double start_s = 0.5;
  for (std::size_t i = 0; i < kFrames.size(); ++i) {
    CapturePlan plan;
    plan.file = "capture-" + std::to_string(i + 1) + ".h5";
    plan.frames = static_cast<std::size_t>(std::max(20.0, std::round(kFrames[i] * options.frames_scale)));
    const double duration_s = static_cast<double>(plan.frames) * 0.005;
    plan.stimulus = stimulus_of(i, duration_s, slant);
    plan.session_start_s = start_s;
    plan.noise_seed = lot.word();
    draw_bench(options.imperfect, edge_px, plan, lot);
    start_s += duration_s + lot.even(1.5, 4.0);
    plans.push_back(std::move(plan));
  }
  for (const sim::EffectSpec& effect : effects) {
    const bool once = effect.name == "nuc_freeze" || effect.name == "offset_jump";
    const std::size_t where = lot.below(plans.size());
    for (std::size_t i = 0; i < plans.size(); ++i) {
      if (once && i != where) continue;
      plans[i].effects.push_back(effect);
      if (once) {
        plans[i].effects.back().values["at_s"] = lot.even(0.25, 0.5) * static_cast<double>(plans[i].frames) * 0.005;
      }
    }
  }
  return plans;
}

}  // namespace

Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index) {
  Session session;
  session.reality = Reality::kSecond;
  session.kind = kind;
  session.index = index;
  session.seed = options.seed * 1'000'003 + static_cast<std::uint64_t>(kind) * 10'007 + index;
  session.geometry = options.geometry;
  Luck lot(session.seed);
  session.camera_seed = lot.word();
  std::vector<const Entry*> all = entries_of(kind);
  if (!options.only.empty()) std::erase_if(all, [&](const Entry* e) { return e->name != options.only; });
  if (kind == Kind::kBench) {
    session.misdescribed = kMisdescribed[index % kMisdescribed.size()];
  } else if (kind != Kind::kEffectFree) {
    if (all.empty()) {
      return bad_input("no effect " + options.only + " for sessions of the kind " + std::string(name_of(kind)) +
                       " in the second reality");
    }
    const Entry& first = *all[index % all.size()];
    session.effects.push_back(drawn(first, lot));
    if (kind == Kind::kPair) {
      std::vector<const Entry*> others = entries_of(kind);
      std::erase_if(others, [&](const Entry* e) { return std::string_view(e->name) == first.name; });
      session.effects.push_back(drawn(*others[lot.below(others.size())], lot));
    }
    if (kind == Kind::kWithheld) session.withheld = first.name;
  }
  session.captures = plan_captures(options, session.effects, lot);
  return session;
}

}  // namespace bolo::tools::blind::second
