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

int info_main(int argc, char** argv);

inline constexpr std::array<Verb, 1> kVerbs{{
    {"info", "what a capture holds and what is odd about it", info_main},
}};

}  // namespace bolo::tools
