// Lets the daemon be ended during set-up, even if a camera blocks it.
#pragma once

#include <chrono>
#include <thread>

namespace bolo::daemon {

// Thread: any.
bool ignored(int signal);

// Until block_signals() SIGTERM and SIGINT end the process at once, with exit code 0; SIGHUP waits. Thread: setup.
void end_by_signals();

// SIGTERM and SIGINT are blocked then, and wait for Daemon::run(); but a camera that answers late, or "wait" again and
// again, holds up the library that asks it for as long as it likes. A signal that has waited for the grace ends the
// process, with a line and exit code 0: nothing is written by then, and the camera lets go of a client that is silent.
// The set-up is over with the guard's end. After block_signals(). Thread: setup.
std::jthread guard_setup(std::chrono::milliseconds grace = std::chrono::seconds(1));

// A signal waits that asks for the end; it stays, for Daemon::run(). After block_signals(). Thread: any.
bool end_requested();

}  // namespace bolo::daemon
