#include "tools/lab/soak/account.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <nlohmann/json.hpp>

#include "src/report/text.hpp"
#include "tools/lab/eval/faults.hpp"

namespace bolo::tools::soak {
namespace {

std::string n(std::uint64_t value) { return std::to_string(value); }

bool unanswered_at(const std::vector<fakecam::Fault>& script, double at_s) {
  return std::ranges::any_of(script, [at_s](const fakecam::Fault& fault) {
    return fault.kind() == fakecam::FaultKind::kNoResend && fault.value("at") == at_s;
  });
}

}  // namespace

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
  b.unheard = static_cast<std::int64_t>(b.passed - b.published - b.lost);
  b.must_be_lost = to.must_be_lost - from.must_be_lost;
  if (b.one_life) b.numbered = to.frame_id - from.frame_id;
  return b;
}

void check_balance(const Balance& b, double silence_s, double period_s, Findings& findings) {
  if (b.one_life) {
    findings.require(
        Invariant::kAccount, b.numbered == b.published + b.lost,
        n(b.numbered) + " frames by the daemon's numbers, " + n(b.published) + " published and " + n(b.lost) + " lost");
  }
  const auto most = b.one_stream ? 0 : kUnheardMargin + static_cast<std::int64_t>(std::ceil(silence_s / period_s));
  const auto least = b.one_stream ? 0 : -kUnheardMargin;
  findings.require(
      Invariant::kCamera, b.unheard >= least && b.unheard <= most,
      n(b.passed) + " frames passed by the camera, " + n(b.published) + " published and " + n(b.lost) +
          " lost: " + std::to_string(b.unheard) + " unaccounted for, where " +
          (b.one_stream ? "none may be" : std::to_string(most) + " may have fallen into the silence of the break"));
  if (b.one_stream && b.must_be_lost > 0) {
    findings.require(Invariant::kInjected, b.lost >= b.must_be_lost,
                     n(b.must_be_lost) + " frames were taken by faults, " + n(b.lost) + " are counted as lost");
  }
}

std::uint64_t must_be_lost(const std::vector<fakecam::InjectedFault>& injected) {
  fakecam::FaultScript script;
  for (const fakecam::InjectedFault& fault : injected) {
    if (auto parsed = fakecam::parse_fault(fault.fault)) script.push_back(std::move(*parsed));
  }
  if (script.size() != injected.size()) return 0;
  fakecam::FaultScript final_script;
  std::vector<fakecam::InjectedFault> taken;
  for (std::size_t i = 0; i < script.size(); ++i) {
    const bool resent = script[i].kind() == fakecam::FaultKind::kLoss && !unanswered_at(script, script[i].value("at"));
    if (resent) continue;
    final_script.push_back(script[i]);
    taken.push_back(injected[i]);
  }
  return total(faults::expected_losses(final_script, taken, false));
}

}  // namespace bolo::tools::soak
