// A verb of a program.
#pragma once

#include <string_view>

namespace bolo::tools {

// argv[0] is the verb itself. Returns the exit code.
using VerbMain = int (*)(int argc, char** argv);

struct Verb {
  std::string_view name;
  std::string_view summary;
  VerbMain run;
};

}  // namespace bolo::tools
