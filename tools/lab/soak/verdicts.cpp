#include <unistd.h>

#include <ctime>
#include <fstream>
#include <sstream>

#include "src/core/statistics.hpp"
#include "tools/lab/soak/verdicts.hpp"

namespace bolo::tools::soak {
namespace {

constexpr double kMibPerKib = 1.0 / 1024.0;

double seconds(double ticks) { return ticks / static_cast<double>(sysconf(_SC_CLK_TCK)); }

int entries_of(const std::filesystem::path& folder) {
  std::error_code error;
  int n = 0;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) ++n;
  return n;
}

// Fields 14 and 15 of /proc/PID/stat; the second one, the name, may contain blanks.
double cpu_seconds(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  const std::size_t name_end = line.rfind(')');
  if (name_end == std::string::npos) return 0.0;
  std::istringstream words(line.substr(name_end + 1));
  std::string word;
  double ticks = 0.0;
  for (int field = 3; field <= 15 && words >> word; ++field) {
    if (field >= 14) ticks += std::stod(word);
  }
  return seconds(ticks);
}

// Nothing if the process is gone.
std::optional<Usage> usage_of(pid_t pid) {
  const std::filesystem::path folder = "/proc/" + std::to_string(pid);
  std::ifstream in(folder / "smaps_rollup");
  Usage usage;
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string key;
    double kib = 0.0;
    if (!(words >> key >> kib)) continue;
    if (key == "Rss:") usage.rss_mib = kib * kMibPerKib;
    if (key == "Pss_Anon:") usage.private_mib = kib * kMibPerKib;
  }
  if (usage.rss_mib <= 0.0) return std::nullopt;
  usage.descriptors = entries_of(folder / "fd");
  usage.threads = entries_of(folder / "task");
  usage.cpu_s = cpu_seconds(folder / "stat");
  return usage;
}

// CPU time of all processors since boot, without niced programs, which give way, s.
double busy_s() {
  std::ifstream in("/proc/stat");
  std::string word;
  in >> word;  // "cpu": user, nice, system, idle, iowait, irq, softirq
  double ticks = 0.0;
  double value = 0.0;
  for (int field = 0; field < 7 && in >> value; ++field) {
    if (field != 1 && field != 3 && field != 4) ticks += value;
  }
  return seconds(ticks);
}

struct Reading {
  double at_s = 0.0;
  double value = 0.0;
};

struct Growth {
  double first = 0.0;           // median of the first fifth
  double last = 0.0;            // median of the last fifth
  double slope_per_hour = 0.0;  // median slope of all pairs (Theil-Sen), robust against outliers
  bool judged = false;          // enough readings

  double by() const { return last - first; }
};

constexpr std::size_t kFewest = 10;
constexpr std::size_t kMostForSlope = 200;  // readings, with about 20,000 pairs
constexpr double kSecondsPerHour = 3600.0;

double median(const std::vector<Reading>& readings, std::size_t from, std::size_t to) {
  std::vector<double> values;
  for (std::size_t i = from; i < to; ++i) values.push_back(readings[i].value);
  return quantile(values, 0.5);
}

double theil_sen(const std::vector<Reading>& readings) {
  const std::size_t step = std::max<std::size_t>(1, readings.size() / kMostForSlope);
  std::vector<double> slopes;
  for (std::size_t i = 0; i < readings.size(); i += step) {
    for (std::size_t j = i + step; j < readings.size(); j += step) {
      slopes.push_back((readings[j].value - readings[i].value) / (readings[j].at_s - readings[i].at_s));
    }
  }
  return quantile(slopes, 0.5);
}

constexpr double kSettle_s = 60.0;  // of a daemon's start, before its memory is judged
// Opened once and kept by libraries: searching for cameras starts libusb, with four files and a thread.
constexpr double kMostDescriptors = 6.0;
constexpr double kMostThreads = 2.0;

using Life = std::vector<const Second*>;

// From `settle_s` after the first reading; judged if the rest spans as long again and has ten readings.
template <typename Value>
Growth growth_of(const Life& life, double settle_s, bool quiet_only, Value value) {
  std::vector<Reading> readings;
  for (const Second* second : life) {
    if (!quiet_only || second->quiet) readings.push_back({second->at_s, static_cast<double>((*second->daemon).*value)});
  }
  Growth growth;
  if (readings.empty()) return growth;
  const double from_s = readings.front().at_s + settle_s;
  const auto begin = std::ranges::find_if(readings, [from_s](const Reading& r) { return r.at_s >= from_s; });
  const std::vector<Reading> rest(begin, readings.end());
  if (rest.size() < kFewest || rest.back().at_s - rest.front().at_s < settle_s) return growth;
  const std::size_t fifth = std::max<std::size_t>(1, rest.size() / 5);
  growth.first = median(rest, 0, fifth);
  growth.last = median(rest, rest.size() - fifth, rest.size());
  growth.slope_per_hour = theil_sen(rest) * kSecondsPerHour;
  growth.judged = true;
  return growth;
}

// True if both measures show growth by `limit` or more: the medians, and the slope over `span_s`.
bool grows(const Growth& growth, double span_s, double limit) {
  return growth.judged && growth.by() >= limit && growth.slope_per_hour * span_s / kSecondsPerHour >= limit / 2;
}

Json growth_json(const Growth& g) {
  if (!g.judged) return nullptr;
  return {{"first", g.first}, {"last", g.last}, {"by", g.by()}, {"slope_per_hour", g.slope_per_hour}};
}

// Latencies: {frames, p50, p99, max}, ms.
Json figures_of(const std::vector<double>& latency_ms) {
  const auto at = [&](double share) { return quantile(latency_ms, share); };
  return {{"frames", latency_ms.size()}, {"p50", at(0.5)}, {"p99", at(0.99)}, {"max", at(1.0)}};
}

constexpr std::size_t kMostWaiting = 12;  // accounts: three seconds

}  // namespace

void Sampler::sample(double now_s, bool quiet) {
  Second second;
  second.at_s = now_s;
  second.quiet = quiet;
  take_flow(second);
  take_usage(second);
  timeline_.push_back(second);
  if (timeline_.size() < 3) return;
  const std::uint64_t lost = lost_too_early(timeline_);
  findings_.require(Invariant::kOverload, lost == 0,
                    std::to_string(lost) + " frames lost for want of time, and none published as it came");
}

void Sampler::take_flow(Second& second) {
  const Flow flow = watcher_.take_flow();
  for (std::size_t i = 0; i < flow.grades.size(); ++i) {
    second.frames += flow.grades[i];
    sum_.grades[i] += flow.grades[i];
  }
  sum_.missed += flow.missed;
  second.undone = flow.undone;
  second.p99_ms = quantile(flow.latency_ms, 0.99);
  if (second.quiet) quiet_ms_.insert(quiet_ms_.end(), flow.latency_ms.begin(), flow.latency_ms.end());
  const Counters counters = watcher_.counters();
  second.life = counters.life;
  for (std::size_t c = 0; c < kLossCauses; ++c) second.lost[c] = counters.lost[c] - counted_.lost[c];
  counted_ = counters;
}

// CPU time of other processes: the total minus that of the soak's own.
void Sampler::take_usage(Second& second) {
  const auto measure = [this](Process& process) {
    const std::optional<Usage> usage = process.ended() ? std::nullopt : usage_of(process.pid());
    if (usage) cpu_of_[process.pid()] = usage->cpu_s;
    return usage;
  };
  second.daemon = measure(rig_.daemon());
  if (rig_.has_camera()) measure(rig_.camera());
  for (Process& reader : rig_.readers()) measure(reader);
  double ours_s = static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
  for (const auto& [pid, cpu_s] : cpu_of_) ours_s += cpu_s;
  const double busy = busy_s();
  const double processors = std::max(1U, std::thread::hardware_concurrency());
  if (!timeline_.empty()) {
    second.others = std::clamp(((busy - busy_s_) - (ours_s - ours_s_)) / processors, 0.0, 1.0);
  }
  busy_s_ = busy;
  ours_s_ = ours_s;
}

void Sampler::finish(SoakResult& result) {
  constexpr std::array kGradeNames{"clean", "sparing", "flagged", "settling", "wrong"};
  result.timeline = std::move(timeline_);
  result.frames["unread"] = sum_.missed;
  for (std::size_t i = 0; i < kGrades; ++i) result.frames[kGradeNames[i]] = sum_.grades[i];
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

void judge_latency(const std::vector<double>& quiet_ms, SoakResult& result, Findings& findings) {
  constexpr double kLimit_ms = 100.0;
  result.quiet = figures_of(quiet_ms);
  std::vector<double> others;
  for (const Second& second : result.timeline) {
    if (second.quiet) others.push_back(second.others);
  }
  result.others_in_quiet = others.empty() ? 0.0 : sum_of(others) / static_cast<double>(others.size());
  const bool busy = result.others_in_quiet > kMostOthers;
  const auto figure = [&](const char* key) { return result.quiet[key].get<double>(); };
  const std::string text =
      plot::format("p50 %.2f, p99 %.2f, max %.1f ms of %zu frames in quiet times; limit of p99 %.0f ms%s",
                   figure("p50"), figure("p99"), figure("max"), quiet_ms.size(), kLimit_ms,
                   busy ? ", not judged: other programs take the processors" : "");
  findings.figure(Invariant::kLatency, text);
  if (busy || quiet_ms.empty()) return;
  findings.require(Invariant::kLatency, figure("p99") <= kLimit_ms, text);
}

void judge_growth(SoakResult& result, Findings& findings) {
  constexpr double kLimit_mib = 1.0;
  std::map<int, Life> lives;
  for (const Second& second : result.timeline) {
    if (second.daemon) lives[second.life].push_back(&second);
  }
  for (const auto& numbered : lives) {
    const Life& life = numbered.second;
    const double lasted_s = life.back()->at_s - life.front()->at_s;
    const double settle_s = std::min(kSettle_s, lasted_s / 3.0);  // files and threads are open at once
    Json& json = result.lives.emplace_back(
        Json{{"life", numbered.first}, {"from_s", life.front()->at_s}, {"to_s", life.back()->at_s}});
    const auto judge = [&](Invariant invariant, const char* key, const Growth& growth, double span_s, double limit,
                           const char* what) {
      json[key] = growth_json(growth);
      if (!growth.judged) return;
      const std::string text = plot::format("life %d, %.0f s: %s from %.2f to %.2f", numbered.first, lasted_s, what,
                                            growth.first, growth.last);
      findings.figure(invariant, text);
      findings.require(invariant, !grows(growth, span_s, limit), text);
    };
    const double memory_s = lasted_s - kSettle_s;
    judge(Invariant::kMemory, "rss_mib", growth_of(life, kSettle_s, false, &Usage::rss_mib), memory_s, kLimit_mib,
          "resident memory, MiB,");
    judge(Invariant::kMemory, "private_mib", growth_of(life, kSettle_s, false, &Usage::private_mib), memory_s,
          kLimit_mib, "private memory, MiB,");
    judge(Invariant::kDescriptors, "threads", growth_of(life, settle_s, true, &Usage::threads), lasted_s - settle_s,
          kMostThreads, "threads");
    judge(Invariant::kDescriptors, "descriptors", growth_of(life, settle_s, true, &Usage::descriptors),
          lasted_s - settle_s, kMostDescriptors, "open files");
  }
}

void Books::update(const CameraBook& camera, const Watcher& watcher, double now_s) {
  const auto& present = camera.present();
  if (present && camera.quiet() && (waiting_.empty() || waiting_.back().account.time_ns != present->time_ns)) {
    waiting_.push_back({*present, camera.mark()});
    if (waiting_.size() > kMostWaiting) waiting_.pop_front();
  }
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    const auto position = watcher.find(waiting_[i].account.last_timestamp_ns, waiting_[i].account.time_ns);
    if (!position) continue;
    Mark mark = waiting_[i].mark;
    mark.at_s = now_s;
    mark.life = position->life;
    mark.frame_id = position->frame_id;
    mark.published = position->published;
    mark.lost_total = position->lost;
    mark.silence_s = position->silence_s;
    compare(mark);
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(i) + 1);
    return;
  }
}

void Books::compare(const Mark& mark) {
  if (last_) {
    const Balance balance = balance_of(*last_, mark);
    check_balance(balance, mark.silence_s - last_->silence_s, period_s_, findings_);
    unaccounted_ += balance.unaccounted;
    ++balances_;
  } else {
    first_ = mark;
  }
  last_ = mark;
}

void Books::close(const faults::Losses& lost, SoakResult& result) const {
  findings_.require(Invariant::kAccount, balances_ > 0, "the books were never compared: no quiet moment");
  const Balance all = first_ ? balance_of(*first_, *last_) : Balance{};
  result.frames = {
      {"passed", all.passed}, {"published", all.published}, {"sent_to_nobody", unaccounted_}, {"balances", balances_}};
  for (std::size_t cause = 0; cause < kLossCauses; ++cause) {
    result.frames["lost"][std::string(name(static_cast<LossCause>(cause)))] = first_ ? lost[cause] : 0;
  }
  if (!first_) return;
  findings_.figure(
      Invariant::kCamera,
      plot::format("%llu passed = %llu published + %llu lost + %lld sent to nobody; compared %llu times",
                   static_cast<unsigned long long>(all.passed), static_cast<unsigned long long>(all.published),
                   static_cast<unsigned long long>(all.lost), static_cast<long long>(unaccounted_),
                   static_cast<unsigned long long>(balances_)));
}

}  // namespace bolo::tools::soak
