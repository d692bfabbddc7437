#include "tools/lab/blind/score.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::tools::blind {
namespace {

constexpr double kSure = 0.95;

bool hides(const Session& session, const std::string& name) {
  return std::ranges::any_of(session.effects, [&](const sim::EffectSpec& e) { return e.name == name; });
}

bool names(const Finding& finding, const std::string& name) {
  return std::ranges::any_of(finding.effects, [&](const Named& e) { return e.name == name; });
}

bool in_three(const Finding& finding, const std::string& name) {
  const auto& effects = finding.effects;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, effects.size()); ++i) {
    if (effects[i].name == name) return true;
  }
  if (effects.empty()) return false;
  const auto& others = effects.front().alternatives;
  const auto end = others.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(2, others.size()));
  return std::find(others.begin(), end, name) != end;
}

bool right_stage(const Session& session, const Finding& finding) {
  return std::ranges::any_of(session.effects, [&](const sim::EffectSpec& effect) {
    const sim::EffectDescription* const description = sim::find_effect(effect.name);
    if (description == nullptr) return false;
    const std::string_view stage = sim::name_of(description->stage);
    return stage == (finding.unexplained_stage.empty() ? finding.location_stage : finding.unexplained_stage);
  });
}

bool passes(Kind kind, const Judgement& j) {
  switch (kind) {
    case Kind::kEffectFree:
      return j.nothing;
    case Kind::kSingle:
      return j.right_first;
    case Kind::kPair:
      return j.all_right;
    case Kind::kOutside:
    case Kind::kWithheld:
      return j.flagged;
    case Kind::kForms:
      return j.right_first || j.flagged;
  }
  return false;
}

std::string joined(const std::string& before, const std::string& name) {
  return before.empty() ? name : before + " + " + name;
}

std::string hidden_text(const Session& session) {
  std::string text;
  for (const sim::EffectSpec& effect : session.effects) {
    text = joined(text, effect.form.empty() ? effect.name : effect.name + '(' + effect.form + ')');
  }
  return text.empty() ? "none" : text;
}

std::string said_text(const Trial& trial) {
  if (!trial.finding) return trial.error;
  std::string text;
  for (const Named& effect : trial.finding->effects) text = joined(text, effect.name);
  return text.empty() ? trial.finding->verdict : trial.finding->verdict + ": " + text;
}

std::string first_named(const Finding& finding, const Judgement& judgement) {
  if (!finding.effects.empty()) return finding.effects.front().name;
  return judgement.flagged ? kUnknown : kNothing;
}

void count(KindScore& kind, const Judgement& j) {
  ++kind.sessions;
  kind.passed += j.passed;
  kind.broken += j.broken;
  kind.right_first += j.right_first;
  kind.right_in_three += j.right_in_three;
  kind.exact += j.exact;
  kind.any_right += j.any_right;
  kind.all_right += j.all_right;
  kind.false_effect += j.false_effect;
  kind.flagged += j.flagged;
  kind.right_stage += j.flagged && j.right_stage;
  kind.blamed += j.blamed;
  kind.nothing += j.nothing;
  kind.sure += j.sure;
  kind.sure_right += j.sure && j.right_first;
}

void cover(std::map<std::string, Coverage>& coverage, const Session& session, const Finding& finding) {
  for (const sim::EffectSpec& hidden : session.effects) {
    const auto named = std::ranges::find(finding.effects, hidden.name, &Named::name);
    if (named == finding.effects.end() || !hidden.form.empty()) continue;
    for (const auto& [key, truth] : hidden.values) {
      const auto found = named->parameters.find(key);
      if (found == named->parameters.end() || !std::isfinite(truth)) continue;
      Coverage& one = coverage[hidden.name + '.' + key];
      ++one.all;
      one.inside += found->second.low <= truth && truth <= found->second.high;
    }
  }
}

void spread_kinds(const std::vector<Trial>& trials, Score& out) {
  for (auto& [kind, kind_score] : out.kinds) {
    std::vector<double> before;
    std::vector<double> after;
    std::vector<double> seconds;
    for (const Trial& trial : trials) {
      if (trial.session.kind != kind) continue;
      seconds.push_back(trial.seconds);
      if (!trial.finding) continue;
      before.push_back(trial.finding->gap_before);
      after.push_back(trial.finding->gap_after);
    }
    kind_score.gap_before = spread_of(std::move(before));
    kind_score.gap_after = spread_of(std::move(after));
    kind_score.seconds = spread_of(std::move(seconds));
  }
}

void tabulate(const Trial& trial, const Judgement& judgement, Score& out) {
  const Session& session = trial.session;
  const std::string said = first_named(*trial.finding, judgement);
  const std::string hidden = session.effects.empty() ? kNothing : session.effects.front().name;
  switch (session.kind) {
    case Kind::kEffectFree:
    case Kind::kSingle:
    case Kind::kForms:
      ++out.confusion[hidden][said];
      break;
    case Kind::kOutside:
    case Kind::kWithheld:
      ++out.instead[hidden][judgement.flagged ? kUnknown : said];
      break;
    case Kind::kPair:
      break;
  }
}

}  // namespace

Judgement judge(const Trial& trial) {
  Judgement j;
  j.broken = !trial.finding;
  if (j.broken) return j;
  const Finding& finding = *trial.finding;
  const Session& session = trial.session;
  const auto& hidden = session.effects;
  const auto is_named = [&](const sim::EffectSpec& effect) { return names(finding, effect.name); };
  j.flagged = finding.verdict == "unknown_effect" || finding.verdict == "partly_explained";
  j.nothing = finding.effects.empty() && !j.flagged;
  j.false_effect =
      std::ranges::any_of(finding.effects, [&](const Named& effect) { return !hides(session, effect.name); });
  j.blamed = j.false_effect && !j.flagged;
  j.any_right = std::ranges::any_of(hidden, is_named);
  j.all_right = !hidden.empty() && std::ranges::all_of(hidden, is_named);
  j.exact = hidden.empty() ? j.nothing : j.all_right && !j.false_effect;
  j.sure = !finding.effects.empty() && finding.effects.front().confidence >= kSure;
  j.right_first = !finding.effects.empty() && hides(session, finding.effects.front().name);
  j.right_in_three = std::ranges::any_of(hidden, [&](const auto& effect) { return in_three(finding, effect.name); });
  j.right_stage = right_stage(session, finding);
  j.passed = passes(session.kind, j);
  return j;
}

Spread spread_of(std::vector<double> values) {
  std::erase_if(values, [](double v) { return std::isnan(v); });
  if (values.empty()) return {};
  std::ranges::sort(values);
  const auto rank = [&](double share) {
    const auto place = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
    return values[std::clamp<std::size_t>(place, 1, values.size()) - 1];
  };
  return {rank(0.5), rank(0.9)};
}

Score score(const std::vector<Trial>& trials) {
  Score out;
  for (const Trial& trial : trials) {
    const Judgement judgement = judge(trial);
    const Session& session = trial.session;
    count(out.kinds[session.kind], judgement);
    if (!judgement.passed) {
      out.failures.push_back({session.kind, session.index, session.seed, hidden_text(session), said_text(trial)});
    }
    if (!trial.finding) continue;
    cover(out.coverage, session, *trial.finding);
    tabulate(trial, judgement, out);
  }
  spread_kinds(trials, out);
  return out;
}

}  // namespace bolo::tools::blind
