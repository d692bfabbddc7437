#include "select.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "nuisance.hpp"

namespace bolo::diagnose {
namespace {

constexpr int kRounds = 4;         // of Gauss and Newton
constexpr std::size_t kTried = 3;  // candidates that are refitted in earnest
constexpr int kMostPolish = 4;
constexpr std::size_t kMostEffects = 8;
constexpr double kLeastEvidence = 8.0;  // of the levels alone
constexpr double kLeastEvidenceScattered = 13.0;

struct Tried {
  Choice choice;
  FitResult fit;
  Gain gain;
};

std::vector<Choice> forms_of(const Effect& effect) {
  if (effect.forms.empty()) return {{&effect, -1}};
  std::vector<Choice> all;
  all.reserve(effect.forms.size());
  for (int f = 0; f < static_cast<int>(effect.forms.size()); ++f) all.push_back({&effect, f});
  return all;
}

// Whether the effect is as large as one that deserves its name.
bool worth_naming(const Session& session, const FitResult& fit, std::size_t choice) {
  const Effect& effect = *fit.choices[choice].effect;
  if (effect.least <= 0.0) return true;
  if (effect.map == MapKind::kNone) return std::abs(fit.value[choice].front()) >= effect.least;
  const CameraModel& c = fit.state.camera;
  const MapSpread spread = spread_of(session, effect.map == MapKind::kOffset ? c.offset
                                              : effect.map == MapKind::kGain ? c.gain
                                                                             : c.tau);
  return std::hypot(spread.pixel, spread.column) >= effect.least;
}

bool enough(const Gain& gain) { return gain.total > kLeastGain && gain.z > kLeastZ; }

class Selector {
 public:
  Selector(const Fitter& fitter, const State& nominal)
      : fitter_(fitter), levels_(nuisances(fitter.session(), nominal)) {}

  // What a fit gains over another: held-out cells, and how well the levels agree with their files. The second part has
  // few values behind it, so it counts on its own only when it is large.
  Gain gain(const FitResult& before, const FitResult& after) const {
    Gain g = gain_between(before.score, after.score);
    const double evidence = level_evidence(levels_, after.state) - level_evidence(levels_, before.state);
    g.total += evidence;
    // Levels of an imperfect bench scatter still: then it takes more to believe that the camera explains some.
    const double needed =
        level_spread(levels_, after.state) > 4.0 * kLevelResolution ? kLeastEvidenceScattered : kLeastEvidence;
    if (evidence > needed && g.total > evidence / 2.0) {
      g.total += kLeastGain;
      g.z = std::max(g.z, evidence / 2.0);
    }
    return g;
  }

  FitResult refit(const FitResult& from, const std::vector<Choice>& choices) const {
    return fitter_.fit(from.state, choices, kRounds);
  }

 private:
  const Fitter& fitter_;
  std::vector<Nuisance> levels_;
};

// The state without one of its effects, as far as the others allow: its coordinates as in `base`, its map gone.
State freed_of(const Session& session, const State& from, const State& base, const Effect& effect) {
  State state = from;
  if (effect.coordinates) {
    for (const Coordinate& c : effect.coordinates(session)) c.set(state, c.get(base));
  }
  CameraModel& camera = state.camera;
  if (effect.map == MapKind::kOffset) camera.offset.resize(0);
  if (effect.map == MapKind::kGain) camera.gain.resize(0);
  if (effect.map == MapKind::kTau) camera.tau.resize(0);
  if (effect.map == MapKind::kDrift) camera.drift_share.resize(0);
  return state;
}

// The same choices, their forms as they are in the state already.
std::vector<Choice> unformed(std::vector<Choice> choices) {
  for (Choice& c : choices) c.form = -1;
  return choices;
}

// The share of redrawn sets of groups in which the first gains more than the second.
double confidence_of(const Score& base, const Score& first, const Score* second) {
  std::mt19937 random(12345);
  const std::size_t groups = base.sum.size();
  if (groups == 0) return 0.0;
  std::uniform_int_distribution<std::size_t> pick(0, groups - 1);
  int wins = 0;
  constexpr int kDraws = 400;
  for (int d = 0; d < kDraws; ++d) {
    double ours = 0.0;
    double other = 0.0;
    for (std::size_t i = 0; i < groups; ++i) {
      const std::size_t g = pick(random);
      ours += base.sum[g] - first.sum[g];
      if (second != nullptr) other += base.sum[g] - second->sum[g];
    }
    if (ours > other && ours > 0.0) ++wins;
  }
  return (wins + 0.5) / (kDraws + 1.0);
}

}  // namespace

Selection select_effects(const Fitter& fitter, const FitResult& base, const std::function<bool(const Effect&)>& allowed,
                         const std::function<bool(const std::string& step, double done)>& progress) {
  Selection s{base, {}};
  const Session& session = fitter.session();
  const State files = nominal_state(session, {});
  const Selector selector(fitter, files);
  while (s.chosen.size() < kMostEffects) {
    std::vector<Choice> candidates;
    for (const Effect* effect : catalogue()) {
      if (!allowed(*effect) || (!effect->coordinates && effect->map == MapKind::kNone)) continue;
      if (!effect->told_by(session)) continue;
      if (std::ranges::any_of(s.chosen, [&](const Chosen& c) { return c.choice.effect == effect; })) continue;
      for (const Choice& form : forms_of(*effect)) candidates.push_back(form);
    }
    const std::string step = "effect " + std::to_string(s.chosen.size() + 1);
    if (!progress(step, 0.2 + 0.08 * static_cast<double>(s.chosen.size()))) break;
    const std::vector<Gain> gains = fitter.screen(s.fit, candidates);
    std::vector<std::size_t> order(candidates.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::ranges::sort(order, std::greater{}, [&](std::size_t i) { return gains[i].total; });
    std::vector<Tried> tried;
    const auto attempt = [&](const Choice& choice) {
      std::vector<Choice> choices;
      for (const Chosen& c : s.chosen) choices.push_back(c.choice);
      choices.push_back(choice);
      // Forms of what was chosen before are set already: only the new one begins.
      for (std::size_t c = 0; c + 1 < choices.size(); ++c) choices[c].form = -1;
      Tried t{choice, selector.refit(s.fit, choices), {}};
      // Levels, and what mixes them with the surroundings, pull at each other: once more.
      if (choice.effect->name == "emissivity") t.fit = selector.refit(t.fit, unformed(choices));
      t.gain = selector.gain(s.fit, t.fit);
      tried.push_back(std::move(t));
    };
    std::vector<const Effect*> seen;
    for (const std::size_t i : order) {
      if (seen.size() >= kTried || gains[i].total < kLeastGain / 2.0) break;
      if (std::ranges::count(seen, candidates[i].effect) > 0) continue;
      seen.push_back(candidates[i].effect);
      attempt(candidates[i]);
    }
    // Levels that are off may be the camera's doing, which a fit with free levels cannot see in the residual.
    const auto all = nuisances(session, files);
    const Effect* emissivity = find_effect("emissivity");
    if (level_spread(all, s.fit.state) > 4.0 * kLevelResolution && emissivity != nullptr && allowed(*emissivity) &&
        std::ranges::count(seen, emissivity) == 0 &&
        std::ranges::none_of(s.chosen, [&](const Chosen& c) { return c.choice.effect == emissivity; })) {
      for (const Choice& form : forms_of(*emissivity)) attempt(form);
    }
    std::erase_if(tried, [&](const Tried& t) { return !worth_naming(session, t.fit, t.fit.choices.size() - 1); });
    std::ranges::sort(tried, std::greater{}, [](const Tried& t) { return t.gain.total; });
    if (tried.empty() || !enough(tried.front().gain)) break;
    Tried& best = tried.front();
    // The winner is fitted to the end: what it leaves is what the next effect is judged by.
    for (int polish = 0; polish < kMostPolish; ++polish) {
      FitResult finer = selector.refit(best.fit, unformed(best.fit.choices));
      const bool done = std::abs(finer.score.gap() / best.fit.score.gap() - 1.0) < 3e-4;
      best.fit = std::move(finer);
      if (done) break;
    }
    Chosen chosen{best.choice, s.fit.score.gap(), best.fit.score.gap(), best.gain, {}, 0.0};
    for (std::size_t i = 1; i < tried.size(); ++i) {
      chosen.alternatives.push_back({tried[i].choice.effect->name, tried[i].fit.score.gap()});
    }
    chosen.confidence = confidence_of(s.fit.score, best.fit.score, tried.size() > 1 ? &tried[1].fit.score : nullptr);
    if (best.gain.z > 2.0 * kLeastZ && tried.size() == 1) chosen.confidence = std::max(chosen.confidence, 0.99);
    s.fit = std::move(best.fit);
    s.chosen.push_back(std::move(chosen));
  }
  // Backward: what no longer pays goes.
  for (bool again = s.chosen.size() > 1; again;) {
    again = false;
    for (std::size_t i = 0; i < s.chosen.size(); ++i) {
      std::vector<Choice> rest;
      for (std::size_t j = 0; j < s.chosen.size(); ++j) {
        if (j != i) rest.push_back(s.chosen[j].choice);
      }
      const FitResult without =
          fitter.fit(freed_of(session, s.fit.state, base.state, *s.chosen[i].choice.effect), unformed(rest), kRounds);
      if (enough(selector.gain(without, s.fit)) && worth_naming(session, s.fit, i)) continue;
      s.fit = without;
      s.chosen.erase(s.chosen.begin() + static_cast<long>(i));
      again = s.chosen.size() > 1;
      break;
    }
  }
  return s;
}

}  // namespace bolo::diagnose
