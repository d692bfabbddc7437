// Notifications to systemd (sd_notify(3)). Without a service manager that listens, nothing happens.
#pragma once

#include <cstdint>
#include <string>

namespace bolo::daemon::service {

// Frames may come from now on; also the end of a reload. `status`: one line for `systemctl status`. Thread: any.
void notify_ready(const std::string& status);
// Thread: any.
void notify_status(const std::string& status);
void notify_reloading();
void notify_stopping();

// Keep-alive pings, when the service manager expects them (WatchdogSec=). Thread: one at a time.
class Watchdog {
 public:
  Watchdog();

  // As often as it needs one, and no more. now_ns: CLOCK_MONOTONIC.
  void feed(std::int64_t now_ns);

 private:
  std::int64_t period_ns_ = 0;  // 0: none are expected
  std::int64_t next_ns_ = 0;
};

}  // namespace bolo::daemon::service
