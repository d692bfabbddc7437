// Notifications to systemd (sd_notify(3)). No effect without a service manager.
#pragma once

#include <cstdint>
#include <string>

namespace bolo::daemon::service {

// Frames may arrive from now on; also ends a reload. `status`: one line for `systemctl status`. Thread: any.
void notify_ready(const std::string& status);
// Thread: any.
void notify_status(const std::string& status);
void notify_reloading();
void notify_stopping();

// Keep-alive pings, if the service manager expects them (WatchdogSec=). Thread: one at a time.
class Watchdog {
 public:
  Watchdog();

  // Sends a ping when one is due. now_ns: CLOCK_MONOTONIC.
  void feed(std::int64_t now_ns);

 private:
  std::int64_t period_ns_ = 0;  // 0: none expected
  std::int64_t next_ns_ = 0;
};

}  // namespace bolo::daemon::service
