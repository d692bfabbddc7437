// `bolo`: dispatches to the verbs.
#include <cstdio>
#include <string_view>

#include "tools/bolo/cli.hpp"
#include "tools/bolo/verbs.hpp"

namespace {

using bolo::tools::kVerbs;

void print_usage(std::FILE* out) {
  std::fputs("bolo: sharp frames from moving thermal cameras\n\nusage: bolo VERB [options], bolo VERB --help\n\n", out);
  for (const auto& verb : kVerbs) {
    std::fprintf(out, "  %-10.*s %.*s\n", static_cast<int>(verb.name.size()), verb.name.data(),
                 static_cast<int>(verb.summary.size()), verb.summary.data());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    print_usage(stderr);
    return bolo::tools::kExitUsage;
  }
  const std::string_view word = argv[1];
  if (word == "--help" || word == "-h" || word == "help") {
    print_usage(stdout);
    return bolo::tools::kExitDone;
  }
  if (word == "--version") {
    std::puts("bolo " BOLO_VERSION);
    return bolo::tools::kExitDone;
  }
  for (const auto& verb : kVerbs) {
    if (verb.name == word) return verb.run(argc - 1, argv + 1);
  }
  std::fprintf(stderr, "bolo: no verb '%s'; 'bolo --help' lists them\n", argv[1]);
  return bolo::tools::kExitUsage;
}
