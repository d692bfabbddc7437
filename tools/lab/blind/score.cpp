#include "tools/lab/blind/score.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "src/report/text.hpp"

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
    case Kind::kBench:
      return j.doubted && !j.false_effect;
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

// What is counted of each kind, in the order of the JSON.
struct Count {
  const char* key;
  bool Judgement::*holds;
  int KindScore::*count;
};
constexpr std::array<Count, 14> kCounts{{{"passed", &Judgement::passed, &KindScore::passed},
                                         {"broken", &Judgement::broken, &KindScore::broken},
                                         {"right_first", &Judgement::right_first, &KindScore::right_first},
                                         {"right_in_top_three", &Judgement::right_in_three, &KindScore::right_in_three},
                                         {"exact", &Judgement::exact, &KindScore::exact},
                                         {"at_least_one", &Judgement::any_right, &KindScore::any_right},
                                         {"all_named", &Judgement::all_right, &KindScore::all_right},
                                         {"false_effect", &Judgement::false_effect, &KindScore::false_effect},
                                         {"flagged", &Judgement::flagged, &KindScore::flagged},
                                         {"flagged_right_stage", &Judgement::right_stage, &KindScore::right_stage},
                                         {"blamed", &Judgement::blamed, &KindScore::blamed},
                                         {"nothing", &Judgement::nothing, &KindScore::nothing},
                                         {"sure", &Judgement::sure, &KindScore::sure},
                                         {"sure_right", &Judgement::sure_right, &KindScore::sure_right}}};

void count(KindScore& kind, const Judgement& judgement) {
  ++kind.sessions;
  for (const Count& one : kCounts) kind.*one.count += judgement.*one.holds ? 1 : 0;
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
    case Kind::kBench:
      break;
  }
}

using nlohmann::ordered_json;
using plot::format;

std::string share(int part, int all) {
  if (all == 0) return "-";
  return format("%d of %d (%.1f %%)", part, all, 100.0 * part / all);
}

// What is asked of each kind, then what else is worth knowing of it.
struct Detail {
  const char* words;
  int KindScore::*part;
};
using S = KindScore;
constexpr Detail kFalse{"another effect besides, or instead", &S::false_effect};
constexpr Detail kSilent{"nothing said", &S::nothing};
constexpr Detail kFlagged{"flagged as unknown or partly explained", &S::flagged};
constexpr Detail kPlaced{"flagged, and the right stage named", &S::right_stage};
const std::map<Kind, std::vector<Detail>> kDetails{
    {Kind::kEffectFree, {{"a false camera effect", &S::false_effect}, {"a false unknown", &S::flagged}}},
    {Kind::kSingle,
     {{"right cause first", &S::right_first},
      {"right cause in the top three", &S::right_in_three},
      {"just the right cause", &S::exact},
      kFalse,
      kSilent}},
    {Kind::kPair,
     {{"both named", &S::all_right}, {"just these two", &S::exact}, {"at least one of them", &S::any_right}, kFalse}},
    {Kind::kOutside, {kFlagged, kPlaced, {"silently blamed on the catalogue", &S::blamed}, kSilent}},
    {Kind::kWithheld, {kFlagged, kPlaced, {"silently blamed on another", &S::blamed}, kSilent}},
    {Kind::kForms,
     {{"the right name first, or flagged", &S::passed},
      {"the right name first", &S::right_first},
      {"flagged as not fully explained", &S::flagged},
      kSilent}},
    {Kind::kBench, {{"the description doubted, and no effect", &S::passed}, {"an effect named", &S::false_effect}}}};

std::string details(Kind kind, const KindScore& s) {
  std::string out;
  for (const Detail& one : kDetails.at(kind)) {
    out += format("    %-44s %s\n", one.words, share(s.*one.part, s.sessions).c_str());
  }
  if (kind == Kind::kSingle) {
    out += format("    %-44s %s\n", "of those it is sure of (0.95), right", share(s.sure_right, s.sure).c_str());
  }
  if (s.broken > 0) out += format("    %-44s %s\n", "no report", share(s.broken, s.sessions).c_str());
  return out;
}

// "row_delay        12: row_delay 11, clock_skew 1"
std::string named_text(const std::map<std::string, std::map<std::string, int>>& table) {
  std::string out;
  for (const auto& [hidden, said] : table) {
    std::vector<std::pair<std::string, int>> counts(said.begin(), said.end());
    std::ranges::stable_sort(counts, [](const auto& a, const auto& b) { return a.second > b.second; });
    int all = 0;
    std::string text;
    for (const auto& [name, count] : counts) {
      all += count;
      text += format("%s%s %d", text.empty() ? "" : ", ", name.c_str(), count);
    }
    out += format("    %-26s %4d: %s\n", hidden.c_str(), all, text.c_str());
  }
  return out;
}

std::string coverage_text(const Score& score) {
  Coverage sum;
  std::string out;
  for (const auto& [key, one] : score.coverage) {
    sum.inside += one.inside;
    sum.all += one.all;
    out += format("    %-36s %s\n", key.c_str(), share(one.inside, one.all).c_str());
  }
  if (sum.all == 0) return {};
  return "  parameters within their 95 % interval: " + share(sum.inside, sum.all) + "\n" + out;
}

ordered_json spread_json(const Spread& spread) { return {{"median", spread.median}, {"p90", spread.p90}}; }

ordered_json kind_json(const KindScore& s) {
  ordered_json out{{"sessions", s.sessions}};
  for (const Count& one : kCounts) out[one.key] = s.*one.count;
  out.update({{"gap_before", spread_json(s.gap_before)},
              {"gap_after", spread_json(s.gap_after)},
              {"seconds", spread_json(s.seconds)}});
  return out;
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
  j.doubted = finding.verdict == "bench_description";
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
  j.right_stage = j.flagged && right_stage(session, finding);
  j.sure_right = j.sure && j.right_first;
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

std::string rerun_words(const Failure& failure, const DrawOptions& draw) {
  std::string words =
      format("bolo-lab blind --kind %s --seed %llu --first %zu --sessions 1",
             std::string(name_of(failure.kind)).c_str(), static_cast<unsigned long long>(draw.seed), failure.index);
  if (draw.reality == Reality::kSecond) words += " --reality second";
  if (draw.imperfect) words += " --imperfect";
  if (draw.magnitude != 1.0) words += format(" --magnitude %g", draw.magnitude);
  if (!draw.only.empty()) words += " --only " + draw.only;
  if (draw.geometry.width != 32) words += format(" --width %d", draw.geometry.width);
  if (draw.geometry.height != 24) words += format(" --height %d", draw.geometry.height);
  if (draw.frames_scale != 1.0) words += format(" --frames-scale %g", draw.frames_scale);
  return words;
}

std::string score_text(const Score& score, const Setting& setting) {
  std::string out;
  for (const auto& [kind, s] : score.kinds) {
    out += format("%s: %d sessions, passed %s\n", std::string(name_of(kind)).c_str(), s.sessions,
                  share(s.passed, s.sessions).c_str());
    out += details(kind, s);
    if (s.broken < s.sessions) {
      out += format("    %-44s %.2f -> %.2f (90 %%: %.2f -> %.2f)\n", "gap before -> after, median",
                    s.gap_before.median, s.gap_after.median, s.gap_before.p90, s.gap_after.p90);
    }
    out += format("    %-44s %.1f (90 %%: %.1f)\n", "seconds a session, median", s.seconds.median, s.seconds.p90);
  }
  if (!score.confusion.empty()) {
    out += "  hidden, and what was named first (- nothing, ? something unknown)\n" + named_text(score.confusion);
  }
  if (!score.instead.empty()) {
    out += "  outside the catalogue or withheld, and what was said (? flagged)\n" + named_text(score.instead);
  }
  out += coverage_text(score);
  if (!score.failures.empty()) out += format("  failed: %zu\n", score.failures.size());
  for (const Failure& failure : score.failures) {
    out += "    " + failure.hidden + " -> " + failure.said + "\n      " + rerun_words(failure, setting.draw) + '\n';
  }
  return out;
}

ordered_json score_json(const Score& score, const Setting& setting) {
  ordered_json kinds = ordered_json::object();
  for (const auto& [kind, s] : score.kinds) kinds[std::string(name_of(kind))] = kind_json(s);
  ordered_json coverage = ordered_json::object();
  for (const auto& [key, one] : score.coverage) coverage[key] = {{"inside", one.inside}, {"all", one.all}};
  ordered_json failures = ordered_json::array();
  for (const Failure& failure : score.failures) {
    failures.push_back({{"kind", name_of(failure.kind)},
                        {"index", failure.index},
                        {"seed", failure.seed},
                        {"hidden", failure.hidden},
                        {"said", failure.said},
                        {"again", rerun_words(failure, setting.draw)}});
  }
  return {{"bolo_blind", 1},
          {"reality", setting.draw.reality == Reality::kSecond ? "second" : "first"},
          {"seed", setting.draw.seed},
          {"imperfect", setting.draw.imperfect},
          {"magnitude", setting.draw.magnitude},
          {"width", setting.draw.geometry.width},
          {"height", setting.draw.geometry.height},
          {"frames_scale", setting.draw.frames_scale},
          {"sealed_sha256", setting.digest},
          {"seconds", setting.seconds},
          {"kinds", std::move(kinds)},
          {"confusion", score.confusion},
          {"said_instead", score.instead},
          {"intervals", std::move(coverage)},
          {"failures", std::move(failures)}};
}

}  // namespace bolo::tools::blind
