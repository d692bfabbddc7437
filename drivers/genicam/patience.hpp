// Limits to the time that Aravis waits for answers.
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

}  // namespace bolo::genicam
