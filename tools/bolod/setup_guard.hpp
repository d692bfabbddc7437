// Lets the daemon be ended during set-up, even if a camera blocks it.
#pragma once

#include <chrono>
#include <thread>

namespace bolo::daemon {

// Thread: any.
bool ignored(int signal);

// Until block_signals(), SIGTERM and SIGINT end the process at once, exit code 0; SIGHUP stays pending. Thread: setup.
void end_by_signals();

// During set-up SIGTERM and SIGINT are blocked and left pending for Daemon::run(), but a camera that answers late, or
// repeatedly asks to wait, can block the library indefinitely. A signal pending for longer than `grace` ends the
// process with a message and exit code 0: nothing has been written yet, and the camera drops a silent client. Destroy
// the guard when set-up is over. Call after block_signals(). Thread: setup.
std::jthread guard_setup(std::chrono::milliseconds grace = std::chrono::seconds(1));

// True when an ending signal is pending; it stays so for Daemon::run(). Call after block_signals(). Thread: any.
bool end_requested();

}  // namespace bolo::daemon
