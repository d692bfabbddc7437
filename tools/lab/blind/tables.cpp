#include "tools/lab/blind/tables.hpp"

#include <algorithm>
#include <vector>

#include "src/report/text.hpp"

namespace bolo::tools::blind {
namespace {

using plot::format;

using nlohmann::ordered_json;

std::string share(int part, int all) {
  if (all == 0) return "-";
  return format("%d of %d (%.1f %%)", part, all, 100.0 * part / all);
}

// What is asked of each kind, then what else is worth knowing of it.
std::string details(Kind kind, const KindScore& s) {
  std::string out;
  const auto add = [&](const char* name, int part) {
    out += format("    %-44s %s\n", name, share(part, s.sessions).c_str());
  };
  switch (kind) {
    case Kind::kEffectFree:
      add("a false camera effect", s.false_effect);
      add("a false unknown", s.flagged);
      break;
    case Kind::kSingle:
      add("right cause first", s.right_first);
      add("right cause in the top three", s.right_in_three);
      add("just the right cause", s.exact);
      add("another effect besides, or instead", s.false_effect);
      add("nothing said", s.nothing);
      out += format("    %-44s %s\n", "of those it is sure of (0.95), right", share(s.sure_right, s.sure).c_str());
      break;
    case Kind::kPair:
      add("both named", s.all_right);
      add("just these two", s.exact);
      add("at least one of them", s.any_right);
      add("another effect besides, or instead", s.false_effect);
      break;
    case Kind::kOutside:
      add("flagged as unknown or partly explained", s.flagged);
      add("flagged, and the right stage named", s.right_stage);
      add("silently blamed on the catalogue", s.blamed);
      add("nothing said", s.nothing);
      break;
    case Kind::kWithheld:
      add("flagged as unknown or partly explained", s.flagged);
      add("flagged, and the right stage named", s.right_stage);
      add("silently blamed on another", s.blamed);
      add("nothing said", s.nothing);
      break;
    case Kind::kForms:
      add("the right name first, or flagged", s.passed);
      add("the right name first", s.right_first);
      add("flagged as not fully explained", s.flagged);
      add("nothing said", s.nothing);
      break;
  }
  if (s.broken > 0) add("no report", s.broken);
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
  return {{"sessions", s.sessions},
          {"passed", s.passed},
          {"broken", s.broken},
          {"right_first", s.right_first},
          {"right_in_top_three", s.right_in_three},
          {"exact", s.exact},
          {"at_least_one", s.any_right},
          {"all_named", s.all_right},
          {"false_effect", s.false_effect},
          {"flagged", s.flagged},
          {"flagged_right_stage", s.right_stage},
          {"blamed", s.blamed},
          {"nothing", s.nothing},
          {"sure", s.sure},
          {"sure_right", s.sure_right},
          {"gap_before", spread_json(s.gap_before)},
          {"gap_after", spread_json(s.gap_after)},
          {"seconds", spread_json(s.seconds)}};
}

}  // namespace

std::string rerun_words(const Failure& failure, const DrawOptions& draw) {
  std::string words =
      format("bolo-lab blind --kind %s --seed %llu --first %zu --sessions 1",
             std::string(name_of(failure.kind)).c_str(), static_cast<unsigned long long>(draw.seed), failure.index);
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
    out += format("    %-44s %.2f -> %.2f (90 %%: %.2f -> %.2f)\n", "gap before -> after, median", s.gap_before.median,
                  s.gap_after.median, s.gap_before.p90, s.gap_after.p90);
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
