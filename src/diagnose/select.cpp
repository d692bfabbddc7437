// Selection of effects: forward with nested refits, then backward elimination.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

constexpr int kRounds = 4;         // of Gauss-Newton
constexpr double kSettled = 3e-4;  // convergence: change of the gap, relative
constexpr std::size_t kTried = 3;  // candidates that get a full refit
constexpr std::size_t kMostEffects = 8;
constexpr double kLargeGain = 200.0;
constexpr double kLeastZOfLarge = 1.6;
constexpr double kNothingLeft = 1.02;       // largest gap that counts as closed
constexpr double kLeastEvidence = 8.0;      // log-likelihood gain of the levels that suffices alone
constexpr double kLevelsOff = 4.0;          // times the scatter of consistent levels
constexpr double kMostConfidence = 0.999;   // the groups of frames cannot support more
constexpr double kHiddenConfidence = 0.99;  // of an effect found in a map that only it changes
constexpr double kUsualGap = 1.05;          // may remain when all effects are known
constexpr double kLeastShare = 0.2;         // of the gap above kUsualGap
constexpr double kMostTrend = 0.5;          // largest share of a trend over rows in a map's mean square

struct Tried {
  Choice choice;
  FitResult fit;
  Gain gain;
};

std::vector<Choice> forms_of(const Effect& effect) {
  if (effect.forms.empty()) return {{&effect}};
  return mapped(effect.forms, [&effect](const Form& form) { return Choice{&effect, &form}; });
}

bool worth_naming(const Session& session, const FitResult& fit, std::size_t choice) {
  const Effect& effect = *fit.choices[choice].effect;
  if (effect.least <= 0.0) return true;
  if (effect.map == MapKind::kNone) return std::abs(fit.value[choice].front()) >= effect.least;
  const MapSpread spread = spread_of(session, map_of(fit.state.camera, effect.map));
  return std::hypot(spread.pixel, spread.column) >= effect.least;
}

// The state without one of its effects: parameters as in `base`, map removed.
State without_effect(const Session& session, const State& from, const State& base, const Effect& effect) {
  State state = from;
  for (const Parameter& c : effect.parameters(session)) c.set(state, c.get(base));
  if (effect.map != MapKind::kNone) map_of(state.camera, effect.map).resize(0);
  return state;
}

struct Selector {
  const FitData& data;
  const FitResult& base;
  const std::function<bool(const Effect&)>& may;
  std::vector<Nuisance> levels = nuisances(data.session, nominal_state(data.session, {}));
  Selection selection{base, {}};

  // kLeastZ is for cells of kCellFrames; shorter cells look more consistent than they are. kLeastZOfLarge (three cells)
  // suffices for a large gain that closes the gap, which no single event produces: a short capture has few edges. Not
  // for maps: a pixel that rests between two jumps gains the same in every cell of a capture.
  bool enough(const Gain& gain, const FitResult& with, const Effect& effect) const {
    const bool is_all = gain.total > kLargeGain && with.score.gap() < kNothingLeft && effect.map == MapKind::kNone;
    const double longer = kCellFrames / static_cast<double>(cell_frames(data.session));
    return gain.total > kLeastGain && gain.z > (is_all ? kLeastZOfLarge : kLeastZ * std::sqrt(longer));
  }

  // Adds the effect of largest gain among those with enough(), fitted to convergence; false if there is none. A larger
  // gain that only a part of the data supports may be what remains afterwards.
  bool add() {
    std::vector<Tried> tried = attempts();
    const auto first =
        std::ranges::find_if(tried, [this](const Tried& t) { return enough(t.gain, t.fit, *t.choice.effect); });
    if (first == tried.end()) return false;
    std::rotate(tried.begin(), first, first + 1);
    Tried& best = tried.front();
    // Converged, because its residual is the basis for the next effect.
    best.fit = settle(data, std::move(best.fit), kRounds, kSettled);
    FoundEffect found = found_in(best.fit, best.choice);
    for (std::size_t i = 1; i < tried.size(); ++i) {  // the best form of each other effect
      const Effect* const effect = tried[i].choice.effect;
      if (effect == best.choice.effect || std::ranges::count(found.alternatives, effect->name, &Alternative::name) > 0)
        continue;
      found.alternatives.push_back({effect->name, tried[i].fit.score.gap()});
    }
    found.confidence = confidence(best.fit, tried.size() > 1 ? tried[1].fit : selection.fit);
    selection.chosen.push_back({best.choice, std::move(found), false, selection.fit.score, best.fit.score});
    selection.fit = std::move(best.fit);
    return true;
  }

  // Adds an effect that a per-pixel map has absorbed; false if there is none.
  bool add_hidden() {
    const Session& session = data.session;
    for (const Effect* effect : candidates()) {
      if (effect->hides_in == MapKind::kNone) continue;
      const double before = row_trend_z(session, map_of(selection.fit.state.camera, effect->hides_in));
      if (before < kClearTrend) continue;
      // First without the map: later rounds could not recover what it has absorbed.
      State start = selection.fit.state;
      map_of(start.camera, effect->hides_in).resize(0);
      const std::vector<Choice> choices = with({effect});
      std::vector<Choice> mapless = choices;
      std::erase_if(mapless, [effect](const Choice& c) { return c.effect->map == effect->hides_in; });
      start = fit(data, start, mapless, 2 * kRounds).state;
      FitResult fitted = settle(data, fit(data, start, choices, kRounds), kRounds, kSettled);
      const double after = row_trend_z(session, map_of(fitted.state.camera, effect->hides_in));
      if (after > before / 2.0 || !worth_naming(session, fitted, choices.size() - 1)) continue;
      // The map may absorb any part of the effect: relative error 1 / significance of the trend.
      double& error = fitted.error.back().front();
      error = std::max(error, std::abs(fitted.value.back().front()) / before);
      FoundEffect found = found_in(fitted, choices.back());
      found.confidence = kHiddenConfidence;
      selection.fit = std::move(fitted);
      selection.chosen.push_back({choices.back(), std::move(found), true});
      return true;
    }
    return false;
  }

  // Removes the effect of smallest gain; false if all gain enough. `stand_ins`: only those that stands_in() finds.
  bool drop(bool stand_ins = false) {
    auto& all = selection.chosen;
    std::optional<std::size_t> least;
    double least_gain = std::numeric_limits<double>::infinity();
    FitResult without_least;
    for (std::size_t i = 0; (stand_ins || all.size() > 1) && i < all.size(); ++i) {
      if (stand_ins ? !stands_in(all[i]) : all[i].from_map) continue;
      std::vector<Choice> rest = unformed(selection.fit.choices);
      rest.erase(rest.begin() + static_cast<long>(i));
      const State start = without_effect(data.session, selection.fit.state, base.state, *all[i].choice.effect);
      FitResult without = fit(data, start, rest, kRounds);
      const Gain paid = gain(without, selection.fit);
      const bool pays = !stand_ins && enough(paid, selection.fit, *all[i].choice.effect);
      if ((pays && worth_naming(data.session, selection.fit, i)) || paid.total >= least_gain) continue;
      least = i;
      least_gain = paid.total;
      without_least = std::move(without);
    }
    if (!least) return false;
    selection.fit = settle(data, std::move(without_least), kRounds, kSettled);
    all.erase(all.begin() + static_cast<long>(*least));
    return true;
  }

  // True if the effect makes the fit of any capture clearly worse.
  bool harms(const Score& before, const Score& after) const {
    return std::ranges::any_of(modelled(data.session), [&](std::size_t i) {
      const Gain gain = gain_between(before, after, i);
      return gain.total < -kLeastGain && gain.z < -kLeastZ;
    });
  }

  // True if an effect has absorbed part of an unknown one: its map makes a capture worse, a parameter is at a bound, it
  // explains little of what remains, or its map is a trend over rows rather than differences of pixels.
  bool stands_in(const Chosen& one) const {
    const Effect& effect = *one.choice.effect;
    if (effect.map != MapKind::kNone && harms(one.before, one.after)) return true;
    double fair = 0.0;
    for (const std::size_t i : modelled(data.session)) {
      const double explains = std::max(0.0, one.before.gap(i) - one.after.gap(i));
      const double left = selection.fit.score.gap(i) - kUsualGap;
      fair += explains < kLeastShare * left ? -explains : explains;
    }
    for (const Parameter& p : effect.parameters(data.session)) {
      const double value = p.get(selection.fit.state);
      if (p.name == effect.inside && (value <= p.low || value >= p.high)) return true;
    }
    if (fair < 0.0 || effect.map == MapKind::kNone) return fair < 0.0;
    const Eigen::VectorXf& map = map_of(selection.fit.state.camera, effect.map);
    return std::pow(row_trend_z(data.session, map), 2) > kMostTrend * spread_of(data.session, map).pixels;
  }

  bool levels_are_off(const State& state) const { return level_error(levels, state) > kLevelsOff * kLevelResolution; }

  // Probability, from the groups' scatter and the levels' likelihoods, that a fit beats the current one and `second`.
  double confidence(const FitResult& first, const FitResult& second) const {
    const auto sure = [&](const FitResult& other) {
      const Gain more = gain_between(other.score, first.score);
      const double by_levels = level_evidence(levels, first.state) - level_evidence(levels, other.state);
      const double scatter = more.z != 0.0 ? more.total / more.z : 1.0;
      return 0.5 * std::erfc(-(more.total + by_levels) / scatter / std::numbers::sqrt2);
    };
    return std::min({sure(selection.fit), sure(second), kMostConfidence});
  }

  // Gain of a fit over another on held-out cells and by the levels' agreement with their files, which suffices alone
  // only if large: levels are few.
  Gain gain(const FitResult& before, const FitResult& after) const {
    Gain g = gain_between(before.score, after.score);
    double evidence = level_evidence(levels, after.state) - level_evidence(levels, before.state);
    // Two parameters fit any two levels; only further ones show that the target deviates, not the black bodies.
    const auto as_levels = [](const Choice& c) { return c.effect->as_levels; };
    if (evidence > 0.0 && std::ranges::any_of(after.choices, as_levels) &&
        std::ranges::none_of(before.choices, as_levels)) {
      evidence *= std::max(0.0, 1.0 - 2.0 / independent_levels(levels, before.state));
    }
    g.total += evidence;
    if (evidence > kLeastEvidence && g.total > evidence / 2.0) {
      g.total += kLeastGain;
      g.z = std::max(g.z, evidence / 2.0);
    }
    return g;
  }

  std::vector<const Effect*> candidates() const {
    std::vector<const Effect*> all;
    for (const Effect& effect : catalogue()) {
      const bool of_mean = effect.map != MapKind::kNone || !effect.parameters(data.session).empty();
      const bool chosen =
          std::ranges::any_of(selection.chosen, [&](const Chosen& c) { return c.choice.effect == &effect; });
      if (of_mean && !chosen && may(effect) && effect.testable_in(data.session)) all.push_back(&effect);
    }
    return all;
  }

  std::vector<Choice> with(const Choice& choice) const {
    std::vector<Choice> choices = unformed(selection.fit.choices);
    choices.push_back(choice);
    return choices;
  }

  Tried attempt(const Choice& choice) const {
    const std::vector<Choice> choices = with(choice);
    Tried tried{choice, fit(data, selection.fit.state, choices, kRounds), {}};
    // Emissivity and levels are correlated and converge slowly: fit again.
    if (choice.effect->as_levels) tried.fit = fit(data, tried.fit.state, unformed(choices), kRounds);
    tried.gain = gain(selection.fit, tried.fit);
    return tried;
  }

  // The most promising candidates, best first.
  std::vector<Tried> attempts() const {
    const std::vector<const Effect*> effects = candidates();
    std::vector<Choice> choices;
    for (const Effect* effect : effects) {
      for (const Choice& form : forms_of(*effect)) choices.push_back(form);
    }
    const std::vector<Gain> gains = screen(data, selection.fit, choices);
    std::vector<std::size_t> order(choices.size());
    std::iota(order.begin(), order.end(), 0U);
    std::ranges::sort(order, std::greater{}, [&](std::size_t i) { return gains[i].total; });
    std::vector<Tried> tried;
    std::vector<const Effect*> seen;
    for (const std::size_t i : order) {
      if (seen.size() >= kTried || gains[i].total < kLeastGain / 2.0) break;
      if (std::ranges::count(seen, choices[i].effect) > 0) continue;
      seen.push_back(choices[i].effect);
      tried.push_back(attempt(choices[i]));
    }
    // The camera may be the cause of deviating levels, but a fit with free levels leaves no residual of that.
    for (const Effect* effect : effects) {
      if (!effect->as_levels || !levels_are_off(selection.fit.state) || std::ranges::count(seen, effect) > 0) continue;
      for (const Choice& form : forms_of(*effect)) tried.push_back(attempt(form));
    }
    std::erase_if(tried, [&](const Tried& t) { return !worth_naming(data.session, t.fit, t.fit.choices.size() - 1); });
    std::ranges::sort(tried, std::greater{}, [](const Tried& t) { return t.gain.total; });
    return tried;
  }

  // An effect with the gaps before and after its addition.
  FoundEffect found_in(const FitResult& fit, const Choice& choice) const {
    FoundEffect found = named(choice.effect->name, 0.0);
    found.gap = {selection.fit.score.gap(), fit.score.gap()};
    return found;
  }
};

}  // namespace

Selection select_effects(const FitData& data, const FitResult& base, const std::function<bool(const Effect&)>& allowed,
                         const Progress& progress) {
  Selector selector{data, base, allowed};
  for (std::size_t found = 0; found < kMostEffects; ++found) {
    if (!progress("effect " + std::to_string(found + 1), 0.2 + 0.08 * static_cast<double>(found))) break;
    if (!selector.add()) break;
  }
  while (selector.drop()) {
  }
  bool hidden = false;
  while (selector.add_hidden()) hidden = true;
  // Naming a smooth effect shrinks the maps that had absorbed it, which may become superfluous.
  while (hidden && selector.drop()) {
  }
  while (selector.drop(true)) {
  }
  return std::move(selector.selection);
}

}  // namespace bolo::diagnose
