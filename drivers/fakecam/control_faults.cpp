#include "drivers/fakecam/control_faults.hpp"

#include <algorithm>
#include <array>

namespace bolo::fakecam {
namespace {

bool strikes_control(FaultKind kind) {
  constexpr std::array kKinds{FaultKind::kNoResend, FaultKind::kFreeze, FaultKind::kControlLoss, FaultKind::kReboot,
                              FaultKind::kWindowingDrop};
  return std::ranges::find(kKinds, kind) != kKinds.end();
}

}  // namespace

ControlFaults::ControlFaults(FaultTallies& tallies, std::int64_t period_ns, Actions actions)
    : tallies_(tallies), actions_(std::move(actions)) {
  const FaultScript& script = tallies.script();
  for (std::size_t i = 0; i < script.size(); ++i) {
    if (strikes_control(script[i].kind()))
      rules_.push_back({script[i].kind(), i, schedule_of(script[i], period_ns), 0});
  }
}

void ControlFaults::begin(std::int64_t now_ns) noexcept {
  if (began_) return;
  began_ = true;
  start_ns_ = now_ns;
}

ControlFaults::Commands ControlFaults::update(std::int64_t now_ns) {
  Commands commands = now_ns < off_until_ns_ ? Commands::kDropped : Commands::kAnswered;
  if (!began_) return commands;
  for (Rule& rule : rules_) {
    if (rule.kind == FaultKind::kNoResend || rule.kind == FaultKind::kWindowingDrop) continue;
    const std::int64_t clock = clock_ns(now_ns);
    if (rule.schedule.begun(clock) > rule.seen) {
      rule.seen = rule.schedule.begun(clock);
      strike(rule);
    }
    if (!rule.schedule.lasts(clock)) continue;
    commands = std::max(commands, rule.kind == FaultKind::kFreeze ? Commands::kFrozen : Commands::kDropped);
  }
  return commands;
}

void ControlFaults::strike(Rule& rule) {
  if (rule.kind == FaultKind::kFreeze) return;  // its frames are counted where they are withheld
  tallies_.add_time(rule.place);
  if (rule.kind == FaultKind::kControlLoss) actions_.drop_client();
  if (rule.kind == FaultKind::kReboot) actions_.reboot();
}

bool ControlFaults::answers_resend(std::int64_t due_ns) noexcept {
  for (const Rule& rule : rules_) {
    if (rule.kind != FaultKind::kNoResend || !rule.schedule.lasts(clock_ns(due_ns))) continue;
    tallies_.add_packets(rule.place);
    return false;
  }
  return true;
}

void ControlFaults::windowing_changed(std::int64_t now_ns) {
  for (const Rule& rule : rules_) {
    if (rule.kind != FaultKind::kWindowingDrop) continue;
    tallies_.add_time(rule.place);
    off_until_ns_ = now_ns + rule.schedule.for_ns;
    actions_.drop_client();
  }
}

}  // namespace bolo::fakecam
