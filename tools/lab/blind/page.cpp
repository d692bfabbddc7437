// The score as a page of its own.
#include <algorithm>
#include <set>
#include <vector>

#include "src/report/page.hpp"
#include "src/report/text.hpp"
#include "tools/lab/blind/tables.hpp"

namespace bolo::tools::blind {
namespace {

using plot::escaped;
using plot::format;
using Table = std::map<std::string, std::map<std::string, int>>;

// What only this page has; the rest is plot::page_style().
constexpr const char* kScoreStyle = R"(
:root{--cell:0,104,168;--miss:194,74,8}
@media(prefers-color-scheme:dark){:root{--cell:93,184,238;--miss:240,144,63}}
table{min-width:560px}td.asked{min-width:190px}code{word-break:break-word}
.bar{display:block;height:10px;background:var(--line);border-radius:3px;min-width:120px}
.bar i{display:block;height:10px;background:var(--after);border-radius:3px}
svg{display:block}svg text{fill:var(--ink);font:12px system-ui,sans-serif}
)";

const char* asked(Kind kind) {
  switch (kind) {
    case Kind::kEffectFree:
      return "nothing is there, and nothing is said";
    case Kind::kSingle:
      return "the one hidden effect is named first";
    case Kind::kPair:
      return "both hidden effects are named";
    case Kind::kOutside:
      return "something unknown is flagged: the effect is not in the catalogue";
    case Kind::kWithheld:
      return "something unknown is flagged: the effect was taken out of the catalogue";
    case Kind::kForms:
      return "another physical form is named right, or flagged";
  }
  return "";
}

std::string kinds_table(const Score& score) {
  std::string out =
      "<h2>What was asked, and how often it came out</h2><div class=scroll><table><tr><th>Sessions<th>Asked"
      "<th class=n>Passed<th><th class=n>False effect<th class=n>Nothing said<th class=n>Gap before<th class=n>after"
      "<th class=n>Seconds</tr>";
  for (const auto& [kind, s] : score.kinds) {
    const double share = s.sessions > 0 ? 100.0 * s.passed / s.sessions : 0.0;
    out += format(
        "<tr><td><b>%s</b><td class=asked>%s<td class=n>%d of %d<td><span class=bar><i "
        "style=\"width:%.1f%%\"></i></span>"
        "<td class=n>%d<td class=n>%d<td class=n>%.2f<td class=n>%.2f<td class=n>%.1f</tr>",
        std::string(name_of(kind)).c_str(), asked(kind), s.passed, s.sessions, share, s.false_effect, s.nothing,
        s.gap_before.median, s.gap_after.median, s.seconds.median);
  }
  return out + "</table></div><p>Gap and seconds are medians.</p>";
}

// Hidden names, then those that were only named.
std::vector<std::string> columns_of(const Table& table) {
  std::set<std::string> names;
  for (const auto& [hidden, said] : table) {
    names.insert(hidden);
    for (const auto& [name, count] : said) names.insert(name);
  }
  return {names.begin(), names.end()};
}

std::string cell(double x, double y, int count, int row_sum, bool right) {
  const double share = static_cast<double>(count) / row_sum;
  return format(
      "<rect x=\"%.0f\" y=\"%.0f\" width=\"21\" height=\"21\" rx=\"2\" fill=\"rgba(var(--%s),%.2f)\" "
      "stroke=\"var(--%s)\" stroke-width=\"%s\"/><text x=\"%.1f\" y=\"%.0f\" text-anchor=\"middle\" "
      "style=\"font-size:11px%s\">%d</text>",
      x, y, right ? "cell" : "miss", 0.15 + 0.85 * share, right ? "after" : "before", right ? "1" : "2", x + 10.5,
      y + 15, share > 0.55 ? ";fill:var(--paper)" : "", count);
}

std::string heat_map(const Table& table) {
  constexpr double kLeft = 190.0;
  constexpr double kTop = 150.0;
  constexpr double kStep = 23.0;
  const std::vector<std::string> columns = columns_of(table);
  const double width = kLeft + kStep * static_cast<double>(columns.size()) + 60.0;
  const double height = kTop + kStep * static_cast<double>(table.size()) + 8.0;
  std::string out = format(
      "<div class=scroll><svg width=\"%.0f\" height=\"%.0f\" role=\"img\" "
      "aria-label=\"hidden effect against first named\">",
      width, height);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const double x = kLeft + kStep * static_cast<double>(i) + 15.0;
    out += format("<text transform=\"translate(%.0f %.0f) rotate(-60)\">%s</text>", x, kTop - 8.0, columns[i].c_str());
    out += format("<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%.0f\" y2=\"%.0f\" stroke=\"var(--line)\" stroke-width=\".5\"/>",
                  x - 4.5, x - 4.5, kTop, height);
  }
  double y = kTop;
  for (const auto& [hidden, said] : table) {
    int sum = 0;
    for (const auto& [name, count] : said) sum += count;
    out += format("<text x=\"%.0f\" y=\"%.0f\" text-anchor=\"end\">%s</text>", kLeft - 8.0, y + 15, hidden.c_str());
    out += format("<line x1=\"%.0f\" x2=\"%.0f\" y1=\"%.1f\" y2=\"%.1f\" stroke=\"var(--line)\" stroke-width=\".5\"/>",
                  kLeft, width - 60.0, y + 10.5, y + 10.5);
    for (const auto& [name, count] : said) {
      const auto column = std::ranges::find(columns, name) - columns.begin();
      out += cell(kLeft + kStep * static_cast<double>(column), y, count, sum, name == hidden);
    }
    y += kStep;
  }
  return out + "</svg></div>";
}

std::string said_table(const Table& table) {
  std::string out = "<div class=scroll><table><tr><th>Hidden<th>Said</tr>";
  for (const auto& [hidden, said] : table) {
    std::string names;
    for (const auto& [name, count] : said) {
      const std::string word = name == kUnknown ? "flagged" : name == kNothing ? "nothing" : name;
      names += format("%s%s %d", names.empty() ? "" : ", ", word.c_str(), count);
    }
    out += "<tr><td>" + escaped(hidden) + "<td>" + escaped(names) + "</tr>";
  }
  return out + "</table></div>";
}

std::string coverage_table(const Score& score) {
  std::string out = "<div class=scroll><table><tr><th>Parameter<th class=n>Inside its interval<th></tr>";
  for (const auto& [key, one] : score.coverage) {
    out += format("<tr><td>%s<td class=n>%d of %d<td><span class=bar><i style=\"width:%.1f%%\"></i></span></tr>",
                  key.c_str(), one.inside, one.all, 100.0 * one.inside / std::max(1, one.all));
  }
  return out + "</table></div>";
}

std::string failures_table(const Score& score, const DrawOptions& draw) {
  std::string out = "<div class=scroll><table><tr><th>Hidden<th>Said<th>Once more</tr>";
  for (const Failure& failure : score.failures) {
    out += "<tr><td>" + escaped(failure.hidden) + "<td>" + escaped(failure.said) + "<td><code>" +
           escaped(rerun_words(failure, draw)) + "</code></tr>";
  }
  return out + "</table></div>";
}

}  // namespace

std::string score_html(const Score& score, const Setting& setting) {
  int sessions = 0;
  int passed = 0;
  for (const auto& [kind, s] : score.kinds) {
    sessions += s.sessions;
    passed += s.passed;
  }
  plot::Page page(format("%d of %d hidden sessions came out right", passed, sessions));
  page.style(kScoreStyle);
  std::string out = format(
      "<p>Seed %llu, %dx%d pixels, effects at %g times their realistic strength, %s stimuli; %.0f s in all. "
      "The answers were sealed before the diagnosis, sha256 <code>%s</code>.</p>",
      static_cast<unsigned long long>(setting.draw.seed), setting.draw.geometry.width, setting.draw.geometry.height,
      setting.draw.magnitude, setting.draw.imperfect ? "imperfect" : "perfect", setting.seconds,
      setting.digest.c_str());
  out += kinds_table(score);
  if (!score.confusion.empty()) {
    out +=
        "<h2>Hidden effect (rows) and the first one named (columns)</h2><p>Blue is right, orange is a mistake. The "
        "darker a cell, the larger its share of the row. - is nothing, ? "
        "something unknown.</p>" +
        heat_map(score.confusion);
  }
  if (!score.instead.empty()) {
    out +=
        "<h2>Effects that no name was there for</h2><p>Outside the catalogue, or withheld from it: right is to flag "
        "them.</p>" +
        said_table(score.instead);
  }
  if (!score.coverage.empty()) {
    out += "<h2>Parameters</h2><p>How often the 95 % interval held the true value.</p>" + coverage_table(score);
  }
  if (!score.failures.empty()) {
    out += "<h2>Sessions that failed</h2><p>Each can be drawn again alone.</p>" + failures_table(score, setting.draw);
  }
  page.html_part(out);
  return page.html();
}

}  // namespace bolo::tools::blind
