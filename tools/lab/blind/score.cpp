
#include "src/core/statistics.hpp"
#include "tools/lab/blind/blind.hpp"

namespace bolo::tools::blind {
namespace {

bool hides(const Session& session, const std::string& name) {
  return std::ranges::any_of(session.effects, [&](const sim::EffectSpec& e) { return e.name == name; });
}

bool names(const Finding& finding, const std::string& name) {
  return std::ranges::any_of(finding.effects, [&](const Named& e) { return e.name == name; });
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

std::string hidden_text(const Session& session) {
  const std::string text =
      joined(mapped(session.effects,
                    [](const sim::EffectSpec& effect) {
                      return effect.form.empty() ? effect.name : effect.name + '(' + effect.form + ')';
                    }),
             " + ");
  return text.empty() ? "none" : text;
}

std::string said_text(const Trial& trial) {
  if (!trial.finding) return trial.error;
  const std::string text = joined(mapped(trial.finding->effects, &Named::name), " + ");
  return text.empty() ? trial.finding->verdict : trial.finding->verdict + ": " + text;
}

constexpr std::array<std::pair<const char*, bool Judgement::*>, 9> kCounts{{{"passed", &Judgement::passed},
                                                                            {"broken", &Judgement::broken},
                                                                            {"right_first", &Judgement::right_first},
                                                                            {"exact", &Judgement::exact},
                                                                            {"all_named", &Judgement::all_right},
                                                                            {"false_effect", &Judgement::false_effect},
                                                                            {"flagged", &Judgement::flagged},
                                                                            {"blamed", &Judgement::blamed},
                                                                            {"nothing", &Judgement::nothing}}};

Json kind_score(const std::vector<const Trial*>& trials) {
  Json out{{"sessions", trials.size()}};
  for (const auto& [key, holds] : kCounts) {
    out[key] = std::ranges::count_if(trials, [holds = holds](const Trial* trial) { return judge(*trial).*holds; });
  }
  return out;
}

using Table = std::map<std::string, std::map<std::string, int>>;

void cover(Table& coverage, const Session& session, const Finding& finding) {
  for (const sim::EffectSpec& hidden : session.effects) {
    const auto named = std::ranges::find(finding.effects, hidden.name, &Named::name);
    if (named == finding.effects.end() || !hidden.form.empty()) continue;
    for (const auto& [key, truth] : hidden.values) {
      const auto found = named->parameters.find(key);
      if (found == named->parameters.end() || !std::isfinite(truth)) continue;
      std::map<std::string, int>& one = coverage[hidden.name + '.' + key];
      ++one["all"];
      one["inside"] += found->second.low <= truth && truth <= found->second.high;
    }
  }
}

void tabulate(const Trial& trial, Table& confusion, Table& instead) {
  const Session& session = trial.session;
  const std::string hidden = session.effects.empty() ? "-" : session.effects.front().name;
  const bool flagged = judge(trial).flagged;
  const std::string unknown = flagged ? "?" : "-";
  const auto& named = trial.finding->effects;
  const std::string said = named.empty() ? unknown : named.front().name;
  switch (session.kind) {
    case Kind::kEffectFree:
    case Kind::kSingle:
    case Kind::kForms:
      ++confusion[hidden][said];
      break;
    case Kind::kOutside:
    case Kind::kWithheld:
      ++instead[hidden][flagged ? "?" : said];
      break;
    case Kind::kPair:
    case Kind::kBench:
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
  j.doubted = finding.verdict == "bench_description";
  j.nothing = finding.effects.empty() && !j.flagged;
  j.false_effect =
      std::ranges::any_of(finding.effects, [&](const Named& effect) { return !hides(session, effect.name); });
  j.blamed = j.false_effect && !j.flagged;
  j.all_right = !hidden.empty() && std::ranges::all_of(hidden, is_named);
  j.exact = hidden.empty() ? j.nothing : j.all_right && !j.false_effect;
  j.right_first = !finding.effects.empty() && hides(session, finding.effects.front().name);
  j.passed = passes(session.kind, j);
  return j;
}

Json score(const std::vector<Trial>& trials, const Setting& setting) {
  std::map<Kind, std::vector<const Trial*>> kinds;
  Table confusion;
  Table instead;
  Table coverage;
  Json failures = Json::array();
  for (const Trial& trial : trials) {
    const Session& session = trial.session;
    kinds[session.kind].push_back(&trial);
    if (!judge(trial).passed) {
      failures.push_back({{"kind", name_of(session.kind)},
                          {"index", session.index},
                          {"hidden", hidden_text(session)},
                          {"said", said_text(trial)},
                          {"again", rerun_words(session.kind, session.index, setting.draw)}});
    }
    if (!trial.finding) continue;
    cover(coverage, session, *trial.finding);
    tabulate(trial, confusion, instead);
  }
  Json scores = Json::object();
  for (const auto& [kind, of_kind] : kinds) scores[std::string(name_of(kind))] = kind_score(of_kind);
  return {{"bolo_blind", 1},
          {"reality", setting.draw.reality == Reality::kSecond ? "second" : "first"},
          {"seed", setting.draw.seed},
          {"imperfect", setting.draw.imperfect},
          {"width", setting.draw.geometry.width},
          {"height", setting.draw.geometry.height},
          {"frames_scale", setting.draw.frames_scale},
          {"sealed_sha256", setting.digest},
          {"seconds", setting.seconds},
          {"kinds", scores},
          {"confusion", confusion},
          {"said_instead", instead},
          {"intervals", coverage},
          {"failures", failures}};
}

std::string rerun_words(Kind kind, std::size_t index, const DrawOptions& draw) {
  std::string words =
      plot::format("bolo-lab blind --kind %s --seed %llu --first %zu --sessions 1", std::string(name_of(kind)).c_str(),
                   static_cast<unsigned long long>(draw.seed), index);
  if (draw.reality == Reality::kSecond) words += " --reality second";
  if (draw.imperfect) words += " --imperfect";
  if (!draw.only.empty()) words += " --only " + draw.only;
  if (draw.geometry.width != 32) words += plot::format(" --width %d", draw.geometry.width);
  if (draw.geometry.height != 24) words += plot::format(" --height %d", draw.geometry.height);
  if (draw.frames_scale != 1.0) words += plot::format(" --frames-scale %g", draw.frames_scale);
  return words;
}

}  // namespace bolo::tools::blind
