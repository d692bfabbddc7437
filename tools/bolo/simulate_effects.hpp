// bolo simulate --list-effects.
#pragma once

namespace bolo::tools {

// Prints every effect with its stage, what it does, its keys and forms: a table, or JSON. Thread: any.
void print_effects(bool json);

}  // namespace bolo::tools
