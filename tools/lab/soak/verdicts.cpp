#include "tools/lab/soak/verdicts.hpp"

#include <algorithm>
#include <cstdio>
#include <map>

#include "src/core/statistics.hpp"

namespace bolo::tools::soak {
namespace {

constexpr double kSettle_s = 60.0;  // of a daemon, before its memory is looked at
// What libraries open once and keep: a camera that is looked for everywhere starts libusb, with four files and a
// thread.
constexpr double kMostDescriptors = 6.0;
constexpr double kMostThreads = 2.0;

using Life = std::vector<const Second*>;

template <typename Value>
Growth growth_of_life(const Life& life, double settle_s, bool quiet_only, Value value) {
  std::vector<Reading> readings;
  for (const Second* second : life) {
    if (!quiet_only || second->quiet) readings.push_back({second->at_s, static_cast<double>((*second->daemon).*value)});
  }
  return growth_of(readings, settle_s);
}

// `settle_s`: of open files and threads, which come at once; memory takes its minute.
LifeGrowth measured(int number, const Life& life, double settle_s) {
  LifeGrowth g;
  g.life = number;
  g.from_s = life.front()->at_s;
  g.to_s = life.back()->at_s;
  g.rss_mib = growth_of_life(life, kSettle_s, false, &Usage::rss_mib);
  g.private_mib = growth_of_life(life, kSettle_s, false, &Usage::private_mib);
  g.pss_mib = growth_of_life(life, kSettle_s, false, &Usage::pss_mib);
  g.descriptors = growth_of_life(life, settle_s, true, &Usage::descriptors);
  g.threads = growth_of_life(life, settle_s, true, &Usage::threads);
  return g;
}

}  // namespace

LatencyFigures figures_of(const std::vector<double>& latency_ms) {
  return {latency_ms.size(), quantile(latency_ms, 0.5), quantile(latency_ms, 0.99), quantile(latency_ms, 1.0)};
}

double others_since(const std::vector<Second>& timeline, double from_s) {
  double most = 0.0;
  for (auto second = timeline.rbegin(); second != timeline.rend() && second->at_s - kSample_s >= from_s; ++second) {
    most = std::max(most, second->others);
  }
  return most;
}

std::uint64_t lost_too_early(const std::vector<Second>& timeline) {
  const std::size_t n = timeline.size();
  if (n < 3) return 0;
  const Second& second = timeline[n - 2];
  const std::uint64_t undone = timeline[n - 3].undone + second.undone + timeline[n - 1].undone;
  const std::uint64_t lost = second.lost[static_cast<std::size_t>(LossCause::kPoolExhausted)] +
                             second.lost[static_cast<std::size_t>(LossCause::kQueueFull)];
  return undone > 0 ? 0 : lost;
}

void judge_latency(const std::vector<double>& quiet_ms, double limit_ms, SoakResult& result, Findings& findings) {
  result.quiet = figures_of(quiet_ms);
  double others = 0.0;
  double seconds = 0.0;
  for (const Second& second : result.timeline) {
    if (!second.quiet) continue;
    others += second.others;
    seconds += 1.0;
  }
  result.others_in_quiet = seconds > 0.0 ? others / seconds : 0.0;
  const bool busy = result.others_in_quiet > kMostOthers;
  char text[200];
  std::snprintf(text, sizeof text,
                "p50 %.2f, p99 %.2f, max %.1f ms of %llu frames in quiet times; limit of p99 %.0f ms%s",
                result.quiet.p50_ms, result.quiet.p99_ms, result.quiet.max_ms,
                static_cast<unsigned long long>(result.quiet.frames), limit_ms,
                busy ? ", not judged: other programs take the processors" : "");
  findings.figure(Invariant::kLatency, text);
  if (busy || result.quiet.frames == 0) return;
  findings.require(Invariant::kLatency, result.quiet.p99_ms <= limit_ms, text);
}

void judge_growth(double limit_mib, SoakResult& result, Findings& findings) {
  std::map<int, Life> lives;
  for (const Second& second : result.timeline) {
    if (second.daemon) lives[second.life].push_back(&second);
  }
  for (const auto& life : lives) {
    const double lasted_s = life.second.back()->at_s - life.second.front()->at_s;
    const double settle_s = std::min(kSettle_s, lasted_s / 3.0);
    const LifeGrowth g = measured(life.first, life.second, settle_s);
    const auto judge = [&](Invariant invariant, const Growth& growth, double span_s, double limit, const char* what) {
      if (!growth.judged) return;
      char text[200];
      std::snprintf(text, sizeof text, "life %d, %.0f s: %s from %.2f to %.2f", g.life, lasted_s, what, growth.first,
                    growth.last);
      findings.figure(invariant, text);
      findings.require(invariant, !grows(growth, span_s, limit), text);
    };
    judge(Invariant::kMemory, g.rss_mib, lasted_s - kSettle_s, limit_mib, "resident memory, MiB,");
    judge(Invariant::kMemory, g.private_mib, lasted_s - kSettle_s, limit_mib, "private memory, MiB,");
    judge(Invariant::kDescriptors, g.threads, lasted_s - settle_s, kMostThreads, "threads");
    judge(Invariant::kDescriptors, g.descriptors, lasted_s - settle_s, kMostDescriptors, "open files");
    result.lives.push_back(g);
  }
}

}  // namespace bolo::tools::soak
