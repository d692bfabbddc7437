// The verbs of `bolo`, one source file each.
#pragma once

#include <array>
#include <string_view>

namespace bolo::tools {

// argv[0] is the verb itself. Returns the exit code.
using VerbMain = int (*)(int argc, char** argv);

struct Verb {
  std::string_view name;
  std::string_view summary;
  VerbMain run;
};

int simulate_main(int argc, char** argv);

inline constexpr std::array<Verb, 1> kVerbs{{
    {"simulate", "write a capture of a simulated camera", simulate_main},
}};

}  // namespace bolo::tools
