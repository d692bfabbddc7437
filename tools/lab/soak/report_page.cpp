// report.html: the answer first, then what happened in time, then the tables.
#include <algorithm>
#include <map>
#include <numeric>

#include "src/core/statistics.hpp"
#include "src/report/page.hpp"
#include "src/report/text.hpp"
#include "tools/lab/soak/frame_judge.hpp"
#include "tools/lab/soak/report.hpp"

namespace bolo::tools::soak {
namespace {

using plot::format;
using plot::Hue;
using plot::Plot;
using plot::Series;

constexpr double kThin = 1.2;  // px: a point a second, for half an hour

std::string count(std::uint64_t n) {
  std::string digits = std::to_string(n);
  for (std::size_t at = digits.size(); at > 3;) digits.insert(at -= 3, ",");
  return digits;
}

plot::Axis time_axis(const SoakResult& result) {
  return {.name = "time", .unit = "s", .low = 0.0, .high = std::max(1.0, result.seconds)};
}

// One value of each second.
template <typename Value>
Series curve(const SoakResult& result, const char* label, Hue hue, Value value) {
  Series series{.kind = plot::Kind::kLine, .label = label, .hue = hue, .width = kThin};
  for (const Second& second : result.timeline) {
    series.x.push_back(second.at_s);
    series.y.push_back(value(second));
  }
  return series;
}

// Each disturbance from its beginning to the first clean frame after it, a row a kind.
Plot disturbances_plot(const SoakResult& result) {
  Plot plot{
      .title = "What went wrong",
      .caption = "From its beginning to its end, and on, in red, until right frames, without a gap, flowed again.",
      .x = time_axis(result)};
  Series lasting{.kind = plot::Kind::kSpans, .hue = Hue::kDeblurred};
  Series recovery{.kind = plot::Kind::kSpans, .hue = Hue::kBad};
  const double least_s = result.seconds / 400.0;  // so that what is over at once can be seen
  for (const Struck& s : result.struck) {
    if (s.begin_s < 0.0) continue;
    const std::string name(info_of(s.disturbance.kind).name);
    const auto known = std::ranges::find(plot.y.categories, name);
    const auto row = static_cast<double>(known - plot.y.categories.begin());
    if (known == plot.y.categories.end()) plot.y.categories.push_back(name);
    const double end_s = s.over ? s.end_s : result.seconds;
    lasting.x.push_back(s.begin_s);
    lasting.y.push_back(row);
    lasting.to.push_back(std::max(end_s, s.begin_s + least_s));
    lasting.titles.push_back(name + (s.disturbance.faults.empty() ? "" : ": " + s.disturbance.faults));
    if (s.recovery_s.value_or(0.0) <= 0.0) continue;
    recovery.x.push_back(end_s);
    recovery.y.push_back(row);
    recovery.to.push_back(end_s + *s.recovery_s);
    recovery.titles.push_back(format("%s: %.2f s to recover", name.c_str(), *s.recovery_s));
  }
  plot.height = 14.0 * static_cast<double>(std::max<std::size_t>(4, plot.y.categories.size()));
  plot.series = {lasting, recovery};
  return plot;
}

Plot rate_plot(const SoakResult& result) {
  Plot plot{.title = "Frames published",
            .caption = "Clean: no flag, and both planes as in an undisturbed run.",
            .x = time_axis(result),
            .y = {.name = "frames", .unit = "1/s", .low = 0.0}};
  plot.series = {curve(result, "all", Hue::kSoft, [](const Second& s) { return static_cast<double>(s.frames); }),
                 curve(result, "clean", Hue::kDeblurred, [](const Second& s) { return static_cast<double>(s.clean); })};
  plot.height = 120.0;
  return plot;
}

Plot latency_plot(const SoakResult& result) {
  Plot plot{.title = "Latency, from the first packet to the published frame",
            .x = time_axis(result),
            .y = {.name = "latency", .unit = "ms", .logarithmic = true}};
  const auto shown = [](double ms, const Second& s) { return s.frames > 0 ? ms : plot::kNone; };
  plot.series = {curve(result, "max", Hue::kSoft, [&](const Second& s) { return shown(s.max_ms, s); }),
                 curve(result, "p99", Hue::kPurple, [&](const Second& s) { return shown(s.p99_ms, s); }),
                 curve(result, "p50", Hue::kDeblurred, [&](const Second& s) { return shown(s.p50_ms, s); })};
  return plot;
}

Plot losses_plot(const SoakResult& result) {
  constexpr std::array kHues{Hue::kBad, Hue::kAmber, Hue::kPurple, Hue::kGreen, Hue::kBlurred, Hue::kTruth, Hue::kSoft};
  static_assert(kHues.size() == kLossCauses);
  Plot plot{.title = "Frames lost",
            .caption = "By cause, each counted once.",
            .x = time_axis(result),
            .y = {.name = "frames", .unit = "1/s", .low = 0.0}};
  for (std::size_t c = 0; c < kLossCauses; ++c) {
    if (result.lost[c] == 0) continue;
    const std::string label(name(static_cast<LossCause>(c)));
    plot.series.push_back(
        curve(result, label.c_str(), kHues[c], [c](const Second& s) { return static_cast<double>(s.lost[c]); }));
  }
  plot.height = 120.0;
  return plot;
}

Plot memory_plot(const SoakResult& result) {
  Plot plot{.title = "The daemon's memory",
            .caption = "Resident with the ring of frames, which readers share; private without it.",
            .x = time_axis(result),
            .y = {.name = "memory", .unit = "MiB", .low = 0.0}};
  const auto of = [](const Second& s, double Usage::*value) { return s.daemon ? (*s.daemon).*value : plot::kNone; };
  plot.series = {
      curve(result, "resident", Hue::kSoft, [&](const Second& s) { return of(s, &Usage::rss_mib); }),
      curve(result, "PSS", Hue::kPurple, [&](const Second& s) { return of(s, &Usage::pss_mib); }),
      curve(result, "private", Hue::kDeblurred, [&](const Second& s) { return of(s, &Usage::private_mib); })};
  plot.height = 140.0;
  return plot;
}

Plot handles_plot(const SoakResult& result) {
  Plot plot{
      .title = "Open files and threads of the daemon", .x = time_axis(result), .y = {.name = "number", .low = 0.0}};
  const auto of = [](const Second& s, int Usage::*value) {
    return s.daemon ? static_cast<double>((*s.daemon).*value) : plot::kNone;
  };
  plot.series = {
      curve(result, "open files", Hue::kDeblurred, [&](const Second& s) { return of(s, &Usage::descriptors); }),
      curve(result, "threads", Hue::kPurple, [&](const Second& s) { return of(s, &Usage::threads); })};
  plot.height = 100.0;
  return plot;
}

plot::Table invariants_table(const Findings& findings) {
  plot::Table table{.head = {"what must hold", "", "looks", "broken", "figures"}};
  for (std::size_t i = 0; i < kInvariants; ++i) {
    const auto invariant = static_cast<Invariant>(i);
    const Findings::Tally tally = findings.tally(invariant);
    const char* holds = tally.broken > 0 ? "BROKEN" : tally.looks > 0 ? "holds" : "not judged";
    table.rows.push_back({std::string(info_of(invariant).name) + ": " + std::string(info_of(invariant).about), holds,
                          count(tally.looks), count(tally.broken), tally.figure});
  }
  return table;
}

plot::Table breaches_table(const Findings& findings) {
  plot::Table table{.head = {"broken", "at, s", "what was found", "during"}};
  for (const Breach& breach : findings.breaches()) {
    table.rows.push_back(
        {std::string(info_of(breach.invariant).name), format("%.2f", breach.at_s), breach.what, breach.during});
  }
  return table;
}

plot::Table kinds_table(const SoakResult& result) {
  std::map<Kind, std::vector<double>> recoveries;
  std::map<Kind, int> times;
  for (const Struck& s : result.struck) {
    if (s.begin_s < 0.0) continue;
    ++times[s.disturbance.kind];
    if (s.recovery_s) recoveries[s.disturbance.kind].push_back(*s.recovery_s);
  }
  plot::Table table{
      .head = {"disturbance", "times", "recovery, s, median", "worst", "limit", "what it is"},
      .caption = "Recovery: from its end until right frames, without a gap, flow again; overload's flags aside."};
  for (const auto& [kind, n] : times) {
    const KindInfo& info = info_of(kind);
    table.rows.push_back({std::string(info.name), std::to_string(n), format("%.2f", quantile(recoveries[kind], 0.5)),
                          format("%.2f", quantile(recoveries[kind], 1.0)), format("%.0f", info.recovers_within_s),
                          std::string(info.about)});
  }
  return table;
}

plot::Table minutes_table(const SoakResult& result) {
  plot::Table table{.head = {"minute", "frames", "p50, ms", "p99, ms", "max, ms"}};
  for (std::size_t i = 0; i < result.minutes.size(); ++i) {
    const LatencyFigures& m = result.minutes[i];
    table.rows.push_back({std::to_string(i + 1), count(m.frames), format("%.2f", m.p50_ms), format("%.2f", m.p99_ms),
                          format("%.1f", m.max_ms)});
  }
  return table;
}

plot::Table lives_table(const SoakResult& result) {
  const auto words = [](const Growth& g) {
    return g.judged ? format("%.2f, %+.2f", g.first, g.by()) : std::string("too short");
  };
  plot::Table table{.head = {"life", "from, s", "to, s", "private, MiB", "resident, MiB", "open files", "threads"},
                    .caption = "Each daemon: the median at first, after it has settled, and by how much it changed."};
  for (const LifeGrowth& g : result.lives) {
    table.rows.push_back({std::to_string(g.life + 1), format("%.0f", g.from_s), format("%.0f", g.to_s),
                          words(g.private_mib), words(g.rss_mib), words(g.descriptors), words(g.threads)});
  }
  return table;
}

std::string losses_words(const SoakResult& result) {
  std::string text;
  for (std::size_t c = 0; c < kLossCauses; ++c) {
    if (result.lost[c] == 0) continue;
    text += (text.empty() ? "" : ", ") + count(result.lost[c]) + " " + std::string(name(static_cast<LossCause>(c)));
  }
  return text.empty() ? "none" : text;
}

void add_facts(plot::Page& page, const SoakResult& result) {
  const auto clean = result.grades[static_cast<std::size_t>(Grade::kClean)];
  page.facts({{count(result.passed), "frames passed by the camera"},
              {count(result.published), "published"},
              {count(std::accumulate(result.lost.begin(), result.lost.end(), std::uint64_t{0})), "lost, each counted"},
              {std::to_string(result.unheard), "sent while nobody listened"},
              {count(result.balances), "times that both books were compared"},
              {count(clean), "frames without a flag, each pixel right"},
              {format("%.1f ms", result.quiet.p50_ms), "latency in quiet times, median"},
              {format("%.1f ms", result.quiet.p99_ms), "99 % of them below"}});
}

}  // namespace

std::string report_page(const SoakRequest& request, const Circumstances& c, const SoakResult& result,
                        const Findings& findings) {
  plot::Page page(result.seconds < 180.0 ? format("A soak of %.0f seconds", result.seconds)
                                         : format("A soak of %.0f minutes", result.seconds / 60.0));
  const auto disturbances = std::ranges::count_if(result.struck, [](const Struck& s) { return s.begin_s >= 0.0; });
  if (findings.all_hold()) {
    page.verdict(plot::Verdict::kGood, "All held",
                 format("Through %d disturbances every frame is accounted for and every pixel is right.",
                        static_cast<int>(disturbances)));
  } else {
    page.verdict(plot::Verdict::kBad, "Broken",
                 format("%d findings in %d disturbances.", static_cast<int>(findings.breaches().size()),
                        static_cast<int>(disturbances)));
  }
  add_facts(page, result);
  if (!findings.breaches().empty()) {
    page.heading("What did not hold");
    page.table(breaches_table(findings));
  }
  page.heading("In time");
  const std::array plots{disturbances_plot(result), rate_plot(result),   latency_plot(result),
                         losses_plot(result),       memory_plot(result), handles_plot(result)};
  page.stacked(plots);
  page.heading("What must hold");
  page.table(invariants_table(findings));
  page.paragraph("Lost, by cause: " + losses_words(result) + ".");
  page.heading("What went wrong, and how long it took to recover");
  page.table(kinds_table(result));
  page.heading("Latency, minute by minute");
  page.table(minutes_table(result));
  page.heading("Each daemon's growth");
  page.table(lives_table(result));
  page.heading("How it was measured");
  for (const std::string& line : c.not_done) page.paragraph("Not done: " + line + ".");
  page.quiet(
      format("%s; %d processors; %s; began %s; bolo %s; %dx%d at %g frames/s; %s; processors and memory were "
             "taken by %s; other programs took %.0f %% of the processors in quiet times; seed %llu.",
             c.machine.c_str(), c.processors, "fake camera, bolod, readers and recorders as processes", c.began.c_str(),
             c.version.c_str(), request.rig.geometry.width, request.rig.geometry.height, request.rig.rate_hz,
             result.solver.c_str(), c.stress.c_str(), 100.0 * result.others_in_quiet,
             static_cast<unsigned long long>(request.schedule.seed)));
  page.code(c.command);
  page.html_part(plot::details_begin("The schedule", "", false));
  page.code(schedule_text(request.schedule));
  page.html_part(plot::kDetailsEnd);
  return page.html();
}

}  // namespace bolo::tools::soak
