#include "tools/lab/soak/report.hpp"

#include <sys/utsname.h>

#include <cstdio>
#include <ctime>
#include <fstream>
#include <set>
#include <thread>

#include "tools/lab/soak/frame_judge.hpp"

namespace bolo::tools::soak {
namespace {

using nlohmann::ordered_json;

constexpr std::array<const char*, 8> kFlagNames{"gap",    "warm_up", "nuc",     "saturated",
                                                "jitter", "reduced", "inverse", "raw"};

// What stands after the colon in the first line of `file` that begins with `key`.
std::string value_of(const char* file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const std::size_t colon = line.find(':');
    if (!line.starts_with(key) || colon == std::string::npos) continue;
    const std::size_t begin = line.find_first_not_of(" \t", colon + 1);
    return begin == std::string::npos ? "" : line.substr(begin);
  }
  return "unknown";
}

std::string machine_text() {
  utsname names{};
  uname(&names);
  return value_of("/proc/cpuinfo", "model name") + ", " + names.sysname + " " + names.release + ", " +
         value_of("/proc/meminfo", "MemTotal") + " of memory";
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[40];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S UTC", &parts);
  return text;
}

ordered_json losses_json(const std::array<std::uint64_t, kLossCauses>& lost) {
  ordered_json json;
  for (std::size_t c = 0; c < kLossCauses; ++c) json[std::string(name(static_cast<LossCause>(c)))] = lost[c];
  return json;
}

ordered_json latency_json(const LatencyFigures& f) {
  return {{"frames", f.frames}, {"p50", f.p50_ms}, {"p99", f.p99_ms}, {"max", f.max_ms}};
}

ordered_json growth_json(const Growth& g) {
  if (!g.judged) return nullptr;
  return {{"first", g.first}, {"last", g.last}, {"by", g.by()}, {"slope_per_hour", g.slope_per_hour}};
}

ordered_json invariants_json(const Findings& findings) {
  ordered_json all = ordered_json::array();
  for (std::size_t i = 0; i < kInvariants; ++i) {
    const auto invariant = static_cast<Invariant>(i);
    const Findings::Tally tally = findings.tally(invariant);
    all.push_back({{"name", info_of(invariant).name},
                   {"about", info_of(invariant).about},
                   {"holds", tally.broken == 0},
                   {"looks", tally.looks},
                   {"broken", tally.broken},
                   {"figure", tally.figure}});
  }
  return all;
}

ordered_json breaches_json(const Findings& findings) {
  ordered_json all = ordered_json::array();
  for (const Breach& breach : findings.breaches()) {
    all.push_back({{"invariant", info_of(breach.invariant).name},
                   {"at_s", breach.at_s},
                   {"what", breach.what},
                   {"during", breach.during}});
  }
  return all;
}

ordered_json struck_json(const SoakResult& result) {
  ordered_json all = ordered_json::array();
  for (const Struck& s : result.struck) {
    if (s.begin_s < 0.0) continue;
    const KindInfo& info = info_of(s.disturbance.kind);
    all.push_back({{"kind", info.name},
                   {"round", s.round},
                   {"begin_s", s.begin_s},
                   {"end_s", s.over ? ordered_json(s.end_s) : ordered_json(nullptr)},
                   {"recovery_s", s.recovery_s ? ordered_json(*s.recovery_s) : ordered_json(nullptr)},
                   {"limit_s", info.recovers_within_s},
                   {"faults", s.disturbance.faults}});
  }
  return all;
}

ordered_json lives_json(const SoakResult& result) {
  ordered_json all = ordered_json::array();
  for (const LifeGrowth& g : result.lives) {
    all.push_back({{"life", g.life},
                   {"from_s", g.from_s},
                   {"to_s", g.to_s},
                   {"private_mib", growth_json(g.private_mib)},
                   {"rss_mib", growth_json(g.rss_mib)},
                   {"pss_mib", growth_json(g.pss_mib)},
                   {"descriptors", growth_json(g.descriptors)},
                   {"threads", growth_json(g.threads)}});
  }
  return all;
}

ordered_json usage_json(const std::optional<Usage>& usage) {
  if (!usage) return nullptr;
  return {{"rss_mib", usage->rss_mib},         {"pss_mib", usage->pss_mib}, {"private_mib", usage->private_mib},
          {"descriptors", usage->descriptors}, {"threads", usage->threads}, {"cpu_s", usage->cpu_s}};
}

ordered_json timeline_json(const SoakResult& result) {
  ordered_json all = ordered_json::array();
  for (const Second& s : result.timeline) {
    all.push_back({{"at_s", s.at_s},
                   {"quiet", s.quiet},
                   {"frames", s.frames},
                   {"clean", s.clean},
                   {"latency_ms", {{"p50", s.p50_ms}, {"p99", s.p99_ms}, {"max", s.max_ms}}},
                   {"lost", losses_json(s.lost)},
                   {"life", s.life},
                   {"daemon", usage_json(s.daemon)},
                   {"reader", usage_json(s.reader)},
                   {"others", s.others}});
  }
  return all;
}

ordered_json flags_json(const SoakResult& result) {
  ordered_json json;
  for (std::size_t bit = 0; bit < kFlagNames.size(); ++bit) json[kFlagNames[bit]] = result.flags[bit];
  return json;
}

ordered_json injected_json(const SoakResult& result) {
  ordered_json all = ordered_json::array();
  for (const fakecam::InjectedFault& f : result.injected) {
    all.push_back({{"fault", f.fault}, {"times", f.times}, {"frames", f.frames}, {"packets", f.packets}});
  }
  return all;
}

}  // namespace

Circumstances circumstances_of(const SoakRequest& request, const Programs& programs, const std::string& command,
                               const std::string& version) {
  Circumstances c;
  c.command = command;
  c.version = version;
  c.machine = machine_text();
  c.processors = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  c.stress = programs.stress.empty() ? "threads of this program: stress-ng is not installed" : programs.stress.string();
  c.began = utc_now();
  std::set<Kind> scheduled;
  for (const Round& round : request.schedule.rounds) {
    for (const Disturbance& d : round.disturbances) scheduled.insert(d.kind);
  }
  for (const KindInfo& info : kinds()) {
    if (scheduled.contains(info.kind)) continue;
    std::string why = "not asked for";
    if (std::ranges::find(request.schedule.no_room, info.kind) != request.schedule.no_room.end()) {
      why = "no room in a run so short";
    } else if (info.kind == Kind::kClockStep) {
      why = "it would set the whole computer's clock: --step-clock does; time_jump moves the camera's";
    } else if (info.kind == Kind::kCameraReplaced) {
      why = "it begins each round after the first, and there is one only";
    }
    c.not_done.push_back(std::string(info.name) + ": " + why);
  }
  return c;
}

ordered_json report_json(const SoakRequest& request, const Circumstances& c, const SoakResult& result,
                         const Findings& findings, bool with_timeline) {
  ordered_json minutes = ordered_json::array();
  for (const LatencyFigures& minute : result.minutes) minutes.push_back(latency_json(minute));
  ordered_json json{{"bolo_soak", 1},
                    {"holds", findings.all_hold()},
                    {"interrupted", result.interrupted},
                    {"seconds", result.seconds},
                    {"seed", request.schedule.seed},
                    {"measured",
                     {{"command", c.command},
                      {"version", c.version},
                      {"machine", c.machine},
                      {"processors", c.processors},
                      {"began", c.began},
                      {"width", request.rig.geometry.width},
                      {"height", request.rig.geometry.height},
                      {"rate_hz", request.rig.rate_hz},
                      {"solver", result.solver},
                      {"taken_by", c.stress},
                      {"others_share_in_quiet", result.others_in_quiet}}},
                    {"not_done", c.not_done},
                    {"invariants", invariants_json(findings)},
                    {"breaches", breaches_json(findings)},
                    {"frames",
                     {{"passed", result.passed},
                      {"sent", result.sent},
                      {"published", result.published},
                      {"lost", losses_json(result.lost)},
                      {"sent_to_nobody", result.unheard},
                      {"balances", result.balances},
                      {"unread", result.unread},
                      {"clean", result.grades[static_cast<std::size_t>(Grade::kClean)]},
                      {"sparing", result.grades[static_cast<std::size_t>(Grade::kSparing)]},
                      {"flagged", result.grades[static_cast<std::size_t>(Grade::kFlagged)]},
                      {"settling", result.grades[static_cast<std::size_t>(Grade::kSettling)]},
                      {"wrong", result.grades[static_cast<std::size_t>(Grade::kWrong)]},
                      {"flags", flags_json(result)}}},
                    {"latency_ms", {{"quiet", latency_json(result.quiet)}, {"minutes", minutes}}},
                    {"lives", lives_json(result)},
                    {"disturbances", struck_json(result)},
                    {"injected", injected_json(result)}};
  if (with_timeline) json["timeline"] = timeline_json(result);
  return json;
}

std::string report_text(const SoakResult& result, const Findings& findings) {
  std::string out;
  char line[512];
  for (std::size_t i = 0; i < kInvariants; ++i) {
    const auto invariant = static_cast<Invariant>(i);
    const Findings::Tally tally = findings.tally(invariant);
    std::snprintf(line, sizeof line, "%-12s %-7s %9llu looks  %s\n", std::string(info_of(invariant).name).c_str(),
                  tally.broken == 0 ? (tally.looks == 0 ? "-" : "holds") : "BROKEN",
                  static_cast<unsigned long long>(tally.looks),
                  (tally.figure.empty() ? std::string(info_of(invariant).about) : tally.figure).c_str());
    out += line;
  }
  double worst_s = 0.0;
  std::size_t struck = 0;
  for (const Struck& s : result.struck) {
    if (s.recovery_s) worst_s = std::max(worst_s, *s.recovery_s);
    struck += s.begin_s >= 0.0 ? 1 : 0;
  }
  std::snprintf(line, sizeof line, "%zu disturbances in %.0f s, the slowest recovery took %.2f s\n", struck,
                result.seconds, worst_s);
  out += line;
  for (const Breach& breach : findings.breaches()) {
    std::snprintf(line, sizeof line, "BROKEN at %.2f s, %s, during %s: ", breach.at_s,
                  std::string(info_of(breach.invariant).name).c_str(), breach.during.c_str());
    out += line + breach.what + "\n";
  }
  return out;
}

std::string schedule_text(const Schedule& schedule) {
  std::string out;
  char line[512];
  std::snprintf(line, sizeof line, "seed %llu: %zu round(s) of %.1f s\n",
                static_cast<unsigned long long>(schedule.seed), schedule.rounds.size(), schedule.round_s);
  out += line;
  for (std::size_t r = 0; r < schedule.rounds.size(); ++r) {
    for (const Disturbance& d : schedule.rounds[r].disturbances) {
      std::snprintf(line, sizeof line, "  round %zu, %7.2f s  for %4.2f s  %-18s %s\n", r, d.at_s, d.for_s,
                    std::string(info_of(d.kind).name).c_str(), d.faults.c_str());
      out += line;
    }
  }
  return out;
}

}  // namespace bolo::tools::soak
