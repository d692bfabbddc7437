// Output of `bolo simulate --list-effects` and `bolo fakecam --list-faults`: a table, or one JSON array.
#pragma once

namespace bolo::tools {

// Every effect with its stage, what it does, its keys and forms. Thread: setup.
void print_effects(bool json);

// Every fault with its keys. Thread: setup.
void print_faults(bool json);

}  // namespace bolo::tools
