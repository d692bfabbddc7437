// What `bolo fakecam --list-faults` prints.
#pragma once

namespace bolo::tools {

// All faults with their keys, as text or as one JSON array. Thread: setup.
void print_faults(bool json);

}  // namespace bolo::tools
