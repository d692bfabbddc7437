// A reader process of the soak: reads every frame as any program does, with libbolo-client.
#pragma once

#include <atomic>
#include <string>

#include "src/core/result.hpp"

namespace bolo::tools::soak {

// Until `stop`; prints a line of JSON twice a second and at the end: frames, missed, restarts, and disorder, frames
// that came in another order than their numbers and times say. slow_ms: what it takes for each frame. Thread: setup.
Status read_along(const std::string& name, int slow_ms, const std::atomic<bool>& stop);

// That line.
struct ReaderAccount {
  unsigned long long frames = 0;
  unsigned long long missed = 0;
  unsigned long long restarts = 0;
  unsigned long long disorder = 0;
};
std::string text_of(const ReaderAccount& account);
// Of the last whole line of such; zeros of none. Thread: any.
ReaderAccount last_account(const std::string& file);

}  // namespace bolo::tools::soak
