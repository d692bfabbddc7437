// From a program's first argument to one of its verbs.
#pragma once

#include <span>
#include <string_view>

namespace bolo::tools {

// A verb of a program. argv[0] is the verb itself; `run` returns the exit code.
struct Verb {
  std::string_view name;
  std::string_view summary;
  int (*run)(int argc, char** argv);
};

struct Program {
  std::string_view name;
  std::string_view summary;
};

// Runs the verb that argv[1] names, or answers --help and --version. Returns the exit code. Thread: main.
int dispatch(const Program& program, std::span<const Verb> verbs, int argc, char** argv);

}  // namespace bolo::tools
