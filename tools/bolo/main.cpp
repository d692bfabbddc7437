// `bolo`: dispatches to the verbs.
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <iostream>
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

// What was printed may have gone to a file on a full disk: that is a failure, too.
int printed(std::string_view verb, int code) {
  std::cout.flush();
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good()) return code;
  std::fprintf(stderr, "bolo %.*s: standard output cannot be written: %s\n", static_cast<int>(verb.size()), verb.data(),
               errno != 0 ? std::strerror(errno) : "the disk took only a part");
  return code == bolo::tools::kExitDone ? bolo::tools::kExitFailed : code;
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
    if (verb.name != word) continue;
    std::signal(SIGXFSZ, SIG_IGN);  // a limit on files is then a full disk: an error of the write, which is told
    return printed(verb.name, verb.run(argc - 1, argv + 1));
  }
  std::fprintf(stderr, "bolo: no verb '%s'; 'bolo --help' lists them\n", argv[1]);
  return bolo::tools::kExitUsage;
}
