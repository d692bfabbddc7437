#include "tools/lab/soak/findings.hpp"

#include <algorithm>
#include <cctype>
#include <utility>

namespace bolo::tools::soak {
namespace {

constexpr std::string_view kTime = "2026-11-22 10:00:00.000 ";

bool begins_with_time(std::string_view line) {
  if (line.size() < kTime.size()) return false;
  return std::equal(kTime.begin(), kTime.end(), line.begin(), [](char form, char c) {
    const bool digit = std::isdigit(static_cast<unsigned char>(form)) != 0;
    return digit ? std::isdigit(static_cast<unsigned char>(c)) != 0 : form == c;
  });
}

constexpr std::array<InvariantInfo, kInvariants> kInfos{{
    {"account", "frames that the daemon's numbers skip are counted as lost, each once"},
    {"camera", "frames that the camera passed are published, lost by cause, or fell into a silence"},
    {"injected", "frames that a fault took for good are among those counted as lost"},
    {"raw", "each raw plane is one of the capture, value by value, as the camera showed it"},
    {"deblurred", "each sharp plane without a flag is that of an undisturbed run, value by value"},
    {"order", "publication numbers rise without a hole; ids and times rise"},
    {"latency", "99 % of the frames of quiet times are published within the limit"},
    {"overload", "no frame is lost for want of time as long as less could be spent on each"},
    {"memory", "the daemon's memory does not grow"},
    {"descriptors", "open files and threads come back to what they were"},
    {"recovery", "after each disturbance frames flow again in time as they should be: right, without a gap"},
    {"log", "the daemon's log has no errors but those that were provoked"},
    {"recordings", "each recording opens, and its planes are the capture's, value by value"},
    {"readers", "readers read on, and end in good order"},
    {"processes", "nothing ends or hangs by itself"},
    {"commands", "reloads and corrections are answered as they should be"},
}};

}  // namespace

LogLine classify(std::string_view line) {
  if (line.starts_with("bolod: ")) return LogLine::kNoStart;
  if (!begins_with_time(line)) return LogLine::kForeign;
  const std::string_view rest = line.substr(kTime.size());
  if (rest.starts_with("warning: ")) return LogLine::kWarning;
  if (!rest.starts_with("error: ") && !rest.starts_with("critical: ")) return LogLine::kUsual;
  if (rest.find("error: reload: ") == 0) return LogLine::kRefusedReload;
  if (rest.find("no signs of life") != std::string_view::npos) return LogLine::kNoLife;
  return LogLine::kError;
}

const InvariantInfo& info_of(Invariant invariant) { return kInfos[static_cast<std::size_t>(invariant)]; }

void Findings::now(double at_s, const std::string& during) {
  const std::lock_guard lock(mutex_);
  at_s_ = at_s;
  during_ = during;
}

void Findings::looked(Invariant invariant, std::uint64_t times) {
  const std::lock_guard lock(mutex_);
  tallies_[static_cast<std::size_t>(invariant)].looks += times;
}

void Findings::broken(Invariant invariant, std::string what) {
  const std::lock_guard lock(mutex_);
  Tally& tally = tallies_[static_cast<std::size_t>(invariant)];
  if (tally.broken++ < kKept) breaches_.push_back({invariant, at_s_, std::move(what), during_});
}

bool Findings::require(Invariant invariant, bool holds, const std::string& what) {
  looked(invariant);
  if (!holds) broken(invariant, what);
  return holds;
}

void Findings::figure(Invariant invariant, std::string text) {
  const std::lock_guard lock(mutex_);
  tallies_[static_cast<std::size_t>(invariant)].figure = std::move(text);
}

Findings::Tally Findings::tally(Invariant invariant) const {
  const std::lock_guard lock(mutex_);
  return tallies_[static_cast<std::size_t>(invariant)];
}

std::vector<Breach> Findings::breaches() const {
  const std::lock_guard lock(mutex_);
  return breaches_;
}

bool Findings::all_hold() const {
  const std::lock_guard lock(mutex_);
  return std::ranges::all_of(tallies_, [](const Tally& tally) { return tally.broken == 0; });
}

}  // namespace bolo::tools::soak
