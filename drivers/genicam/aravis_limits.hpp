// Limits on what a camera can make Aravis do: wait, and divide.
#pragma once

namespace bolo::genicam {

// While an instance lives, a camera search on this thread ends after a few seconds. Aravis's own search continues as
// long as any packets arrive, from any sender. Thread: any.
class SearchLimit {
 public:
  SearchLimit() noexcept;
  ~SearchLimit();
  SearchLimit(const SearchLimit&) = delete;
  SearchLimit& operator=(const SearchLimit&) = delete;
};

// aravis_limits.cpp also replaces g_socket_receive() to limit the PENDING_ACK waiting time, which a camera (or a forged
// packet) could otherwise set to a minute, repeatedly.

// Makes INT64_MIN / -1 yield 0 from now on; other faults are unaffected. Aravis evaluates formulas from the camera, and
// this division raises SIGFPE on x86-64 (not on arm64). Thread: any.
void survive_division_of_smallest() noexcept;

}  // namespace bolo::genicam
