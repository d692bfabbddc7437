// The `/events` dataset: compound (t float64, kind string).
#pragma once

#include <vector>

#include "src/capture/capture.hpp"
#include "src/capture/h5.hpp"

namespace bolo::capture {

inline constexpr std::size_t kLongestEventKind = 63;  // bytes; stored in 64 with the closing zero

// Empty when the dataset is absent. `kind` may be of fixed or variable length. Errors (kBadInput) name the item.
// Thread: any one at a time.
Result<std::vector<Event>> read_events(hid_t file);

// Appends to the dataset, which is created by the first call. False on failure. Thread: any one at a time.
bool append_events(hid_t file, const std::vector<Event>& events);

}  // namespace bolo::capture
