#include "tools/cli/dispatch.hpp"

#include <cstdio>
#include <string>

#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

void print_usage(const Program& program, std::span<const Verb> verbs, std::FILE* out) {
  const std::string name(program.name);
  std::fprintf(out, "%s: %s\n\nusage: %s VERB [options], %s VERB --help\n\n", name.c_str(),
               std::string(program.summary).c_str(), name.c_str(), name.c_str());
  for (const Verb& verb : verbs) {
    std::fprintf(out, "  %-10.*s %.*s\n", static_cast<int>(verb.name.size()), verb.name.data(),
                 static_cast<int>(verb.summary.size()), verb.summary.data());
  }
}

}  // namespace

int dispatch(const Program& program, std::span<const Verb> verbs, int argc, char** argv) {
  const std::string name(program.name);
  set_program_name(name);
  if (argc < 2) {
    print_usage(program, verbs, stderr);
    return kExitUsage;
  }
  const std::string_view word = argv[1];
  if (word == "--help" || word == "-h" || word == "help") {
    print_usage(program, verbs, stdout);
    return kExitDone;
  }
  if (word == "--version") {
    std::printf("%s " BOLO_VERSION "\n", name.c_str());
    return kExitDone;
  }
  for (const Verb& verb : verbs) {
    if (verb.name == word) return verb.run(argc - 1, argv + 1);
  }
  std::fprintf(stderr, "%s: no verb '%s'; '%s --help' lists them\n", name.c_str(), argv[1], name.c_str());
  return kExitUsage;
}

}  // namespace bolo::tools
