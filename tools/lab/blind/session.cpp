#include "tools/lab/blind/session.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "tools/lab/blind/captures.hpp"
#include "tools/lab/blind/dice.hpp"

namespace bolo::tools::blind {
namespace {

constexpr std::array<std::string_view, kKinds> kNames{"effect-free", "single", "pair", "outside", "withheld", "forms"};

// An effect and its form.
struct Choice {
  std::string_view effect;
  std::string_view form;
};

// What a session of this kind may hide, in the order of the turns.
std::vector<Choice> choices(Kind kind) {
  std::vector<Choice> out;
  for (const sim::EffectDescription& effect : sim::effect_descriptions()) {
    if (effect.in_catalogue == (kind == Kind::kOutside) || kind == Kind::kEffectFree) continue;
    if (kind != Kind::kForms) out.push_back({effect.name, {}});
    for (std::size_t i = 1; kind == Kind::kForms && i < effect.forms.size(); ++i) {
      out.push_back({effect.name, effect.forms[i]});
    }
  }
  return out;
}

// Words that depend on the session's place and on `what` is drawn with them.
std::uint64_t session_seed(const DrawOptions& options, Kind kind, std::size_t index) {
  return mix(mix(mix(options.seed) + static_cast<std::uint64_t>(kind)) + index);
}

Result<sim::EffectSpec> drawn(const Choice& choice, double magnitude, Dice& dice) {
  auto effect = sim::draw_effect(choice.effect, dice.word());
  if (!effect) return effect;
  effect->form = choice.form;
  place_in_scene(*effect, dice);
  return weakened(std::move(*effect), magnitude);
}

Status draw_effects(const DrawOptions& options, Session& session, Dice& dice) {
  if (session.kind == Kind::kEffectFree) return {};
  std::vector<Choice> all = choices(session.kind);
  if (!options.only.empty()) {
    std::erase_if(all, [&](const Choice& c) { return c.effect != options.only; });
  }
  if (all.empty()) {
    return bad_input("no effect " + (options.only.empty() ? "at all" : options.only) + " for sessions of the kind " +
                     std::string(name_of(session.kind)) + "; 'bolo simulate --list-effects' names them");
  }
  std::vector<Choice> chosen{all[session.index % all.size()]};
  if (session.kind == Kind::kPair) {
    std::vector<Choice> others = choices(Kind::kPair);
    std::erase_if(others, [&](const Choice& c) { return c.effect == chosen[0].effect; });
    chosen.push_back(others[dice.below(others.size())]);
  }
  for (const Choice& choice : chosen) {
    auto effect = drawn(choice, options.magnitude, dice);
    if (!effect) return tl::unexpected(effect.error());
    session.effects.push_back(std::move(*effect));
  }
  if (session.kind == Kind::kWithheld) session.withheld = session.effects[0].name;
  return {};
}

// How a parameter's strength is weakened.
enum class Strength { kNone, kAboutZero, kAboutOne, kInverse };

Strength strength_of(const sim::EffectSpec& effect, std::string_view key) {
  constexpr std::array<std::string_view, 3> kAboutOneKeys{"scale", "alpha", "emissivity"};
  constexpr std::array<std::string_view, 21> kAboutZeroKeys{
      "rms",          "share",   "row_delay_s", "pixel_k",  "column_k", "row_k",         "amplitude_k",
      "amplitude",    "sigma_k", "corner_hz",   "step_k",   "sigma_px", "coupling",      "corner_loss",
      "per_thousand", "rms_s",   "skew",        "offset_k", "jump_k",   "freeze_frames", "window_s"};
  if (std::ranges::find(kAboutOneKeys, key) != kAboutOneKeys.end()) return Strength::kAboutOne;
  if (std::ranges::find(kAboutZeroKeys, key) != kAboutZeroKeys.end()) return Strength::kAboutZero;
  if (key == "degrees") return Strength::kInverse;
  // Of telegraph noise the step is weakened, not the number of pixels.
  return key == "fraction" && effect.name != "rts" ? Strength::kAboutZero : Strength::kNone;
}

nlohmann::json to_json(const sim::EffectSpec& effect) {
  nlohmann::json values = nlohmann::json::object();
  for (const auto& [key, value] : effect.values) {
    if (std::isfinite(value)) values[key] = value;
  }
  return {{"name", effect.name}, {"form", effect.form}, {"values", std::move(values)}};
}

nlohmann::json to_json(const std::vector<sim::EffectSpec>& effects) {
  nlohmann::json out = nlohmann::json::array();
  for (const sim::EffectSpec& effect : effects) out.push_back(to_json(effect));
  return out;
}

}  // namespace

std::string_view name_of(Kind kind) { return kNames[static_cast<std::size_t>(kind)]; }

std::optional<Kind> kind_named(std::string_view name) {
  const auto* const found = std::ranges::find(kNames, name);
  if (found == kNames.end()) return std::nullopt;
  return static_cast<Kind>(found - kNames.begin());
}

std::vector<std::string> effects_of(Kind kind) {
  std::vector<std::string> names;
  for (const Choice& choice : choices(kind)) {
    if (names.empty() || names.back() != choice.effect) names.emplace_back(choice.effect);
  }
  return names;
}

sim::EffectSpec weakened(sim::EffectSpec effect, double magnitude) {
  const sim::EffectDescription* const description = sim::find_effect(effect.name);
  if (description == nullptr || magnitude == 1.0) return effect;
  for (const sim::Parameter& parameter : description->parameters) {
    const auto found = effect.values.find(parameter.key);
    const double value = found != effect.values.end() ? found->second : parameter.standard;
    const Strength strength = strength_of(effect, parameter.key);
    if (strength == Strength::kNone || !std::isfinite(value)) continue;
    double weak = value * magnitude;
    if (strength == Strength::kAboutOne) weak = 1.0 + (value - 1.0) * magnitude;
    if (strength == Strength::kInverse) weak = value / magnitude;
    effect.values[std::string(parameter.key)] = std::clamp(weak, parameter.accepted.low, parameter.accepted.high);
  }
  return effect;
}

Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index) {
  Session session;
  session.kind = kind;
  session.index = index;
  session.seed = session_seed(options, kind, index);
  session.geometry = options.geometry;
  Dice dice(session.seed);
  session.camera_seed = dice.word() >> 1U;
  if (Status drawn = draw_effects(options, session, dice); !drawn) return tl::unexpected(drawn.error());
  session.captures = plan_captures(options, session.effects, dice);
  return session;
}

nlohmann::json to_json(const Session& session) {
  nlohmann::json captures = nlohmann::json::array();
  for (const CapturePlan& plan : session.captures) {
    captures.push_back({{"file", plan.file},
                        {"frames", plan.frames},
                        {"session_start_s", plan.session_start_s},
                        {"noise_seed", plan.noise_seed},
                        {"effects", to_json(plan.effects)},
                        {"stimulus_error", sim::stimulus_error_text(plan.faults)}});
  }
  return {{"kind", name_of(session.kind)},
          {"index", session.index},
          {"seed", session.seed},
          {"effects", to_json(session.effects)},
          {"withheld", session.withheld},
          {"width", session.geometry.width},
          {"height", session.geometry.height},
          {"camera_seed", session.camera_seed},
          {"captures", std::move(captures)}};
}

}  // namespace bolo::tools::blind
