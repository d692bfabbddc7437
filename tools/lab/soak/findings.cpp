#include <algorithm>
#include <cctype>
#include <numeric>

#include "tools/lab/soak/findings.hpp"

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

std::string n(std::uint64_t value) { return std::to_string(value); }

}  // namespace

LogLine classify(std::string_view line) {
  if (!begins_with_time(line)) return LogLine::kWrong;
  const std::string_view rest = line.substr(kTime.size());
  if (!rest.starts_with("error: ") && !rest.starts_with("critical: ")) return LogLine::kFine;
  if (rest.starts_with("error: reload: ")) return LogLine::kRefusedReload;
  return rest.find("no signs of life") != std::string_view::npos ? LogLine::kNoLife : LogLine::kWrong;
}

const InvariantInfo& info_of(Invariant invariant) { return kInfos[static_cast<std::size_t>(invariant)]; }

void Findings::now(double at_s, const std::string& during) {
  const std::lock_guard lock(mutex_);
  at_s_ = at_s;
  during_ = during;
}

void Findings::count_check(Invariant invariant, std::uint64_t times) {
  const std::lock_guard lock(mutex_);
  tallies_[static_cast<std::size_t>(invariant)].checks += times;
}

void Findings::broken(Invariant invariant, std::string what) {
  const std::lock_guard lock(mutex_);
  Tally& tally = tallies_[static_cast<std::size_t>(invariant)];
  if (tally.broken++ < kKept) breaches_.push_back({invariant, at_s_, std::move(what), during_});
}

bool Findings::require(Invariant invariant, bool holds, const std::string& what) {
  count_check(invariant);
  if (!holds) broken(invariant, what);
  return holds;
}

bool Findings::done(Invariant invariant, const Status& status) {
  if (!status) broken(invariant, status.error().message);
  return status.has_value();
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

std::uint64_t total(const faults::Losses& lost) { return std::accumulate(lost.begin(), lost.end(), std::uint64_t{0}); }

std::uint64_t CameraAccount::skipped_ids() const {
  std::uint64_t ids = 0;
  for (const fakecam::InjectedFault& fault : injected) {
    if (fault.fault.starts_with("id_gap")) ids += fault.frames;
  }
  return ids;
}

std::optional<CameraAccount> parse_account(const std::string& line) {
  const auto json = nlohmann::json::parse(line, nullptr, false);
  if (!json.is_object() || !json.contains("frames_passed")) return std::nullopt;
  CameraAccount account;
  account.time_ns = json.value("time_ns", std::int64_t{0});
  account.first_stream_ns = json.value("first_stream_ns", std::int64_t{0});
  account.last_timestamp_ns = json.value("last_timestamp_ns", std::int64_t{0});
  account.passed = json.value("frames_passed", std::uint64_t{0});
  account.sent = json.value("frames_sent", std::uint64_t{0});
  account.streams = json.value("streams_started", std::uint64_t{0});
  for (const auto& fault : json.value("faults", nlohmann::json::array())) {
    account.injected.push_back({fault.value("fault", ""), fault.value("times", std::uint64_t{0}),
                                fault.value("frames", std::uint64_t{0}), fault.value("packets", std::uint64_t{0})});
  }
  return account;
}

Balance balance_of(const Mark& from, const Mark& to) {
  Balance b;
  b.one_life = from.life == to.life;
  b.one_stream = b.one_life && from.camera == to.camera && from.streams == to.streams;
  b.passed = to.passed + to.skipped_ids - from.passed - from.skipped_ids;
  b.published = to.published - from.published;
  b.lost = to.lost_total - from.lost_total;
  b.unaccounted = static_cast<std::int64_t>(b.passed - b.published - b.lost);
  if (b.one_life) b.numbered = to.frame_id - from.frame_id;
  return b;
}

void check_balance(const Balance& b, double silence_s, double period_s, Findings& findings) {
  if (b.one_life) {
    findings.require(
        Invariant::kAccount, b.numbered == b.published + b.lost,
        n(b.numbered) + " frames by the daemon's numbers, " + n(b.published) + " published and " + n(b.lost) + " lost");
  }
  const auto most = b.one_stream ? 0 : kUnaccountedMargin + static_cast<std::int64_t>(std::ceil(silence_s / period_s));
  const auto least = b.one_stream ? 0 : -kUnaccountedMargin;
  findings.require(
      Invariant::kCamera, b.unaccounted >= least && b.unaccounted <= most,
      n(b.passed) + " frames passed by the camera, " + n(b.published) + " published and " + n(b.lost) +
          " lost: " + std::to_string(b.unaccounted) + " unaccounted for, where " +
          (b.one_stream ? "none may be" : std::to_string(most) + " may have fallen into the silence of the break"));
}

}  // namespace bolo::tools::soak
