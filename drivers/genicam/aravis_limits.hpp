// Limits to what a camera can have Aravis do: wait, and divide.
#pragma once

namespace bolo::genicam {

// While one lives, a search for cameras on this thread ends after some seconds: Aravis's own goes on for as long as
// packets come, whatever they are and whoever sends them. Thread: any.
class SearchLimit {
 public:
  SearchLimit() noexcept;
  ~SearchLimit();
  SearchLimit(const SearchLimit&) = delete;
  SearchLimit& operator=(const SearchLimit&) = delete;
};

// Not to be called: also linked in place of GLib's function is one that shortens the time for which a camera, or
// whoever sends in its name, has Aravis wait by PENDING_ACK. That may be a minute, and again and again.

// The smallest of all integers divided by -1 has no result. Aravis evaluates cameras' formulas, including that
// division, which is a fault of the processor on x86-64 (SIGFPE) and nothing on arm64. From here on its result is 0;
// every other fault is as it was. Thread: any.
void survive_division_of_smallest() noexcept;

}  // namespace bolo::genicam
