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

int deblur_main(int argc, char** argv);
int fakecam_main(int argc, char** argv);
int stat_main(int argc, char** argv);

inline constexpr std::array<Verb, 3> kVerbs{{
    {"deblur", "undo the pixels' thermal inertia in a capture", deblur_main},
    {"fakecam", "serve a capture as a GigE Vision camera", fakecam_main},
    {"stat", "what a running daemon does: rates, losses, latency", stat_main},
}};

}  // namespace bolo::tools
