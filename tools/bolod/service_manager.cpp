#include "tools/bolod/service_manager.hpp"

#include <systemd/sd-daemon.h>

#include "src/core/clock.hpp"

namespace bolo::daemon::service {
namespace {

constexpr std::int64_t kFeedsAPeriod = 4;  // tolerates a late one

// The result is ignored: the daemon works the same without a service manager.
void notify(const std::string& state) { sd_notify(0, state.c_str()); }

}  // namespace

void notify_ready(const std::string& status) { notify("READY=1\nSTATUS=" + status); }

void notify_status(const std::string& status) { notify("STATUS=" + status); }

void notify_reloading() {
  notify("RELOADING=1\nMONOTONIC_USEC=" + std::to_string(monotonic_ns() / kNsPerUs) +
         "\nSTATUS=reading its file again");
}

void notify_stopping() { notify("STOPPING=1\nSTATUS=ending"); }

Watchdog::Watchdog() {
  std::uint64_t period_us = 0;
  if (sd_watchdog_enabled(0, &period_us) <= 0) return;
  period_ns_ = static_cast<std::int64_t>(period_us) * kNsPerUs / kFeedsAPeriod;
}

void Watchdog::feed(std::int64_t now_ns) {
  if (period_ns_ == 0 || now_ns < next_ns_) return;
  next_ns_ = now_ns + period_ns_;
  notify("WATCHDOG=1");
}

}  // namespace bolo::daemon::service
