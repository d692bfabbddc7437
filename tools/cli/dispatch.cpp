#include "tools/cli/dispatch.hpp"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <iostream>
#include <new>
#include <string>

#include "src/core/printable.hpp"
#include "src/core/standard_streams.hpp"
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

// Output may have gone to a file on a full disk: that is a failure, too.
int printed(const std::string& who, int code) {
  std::cout.flush();
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good()) return code;
  std::fprintf(stderr, "%s: standard output cannot be written: %s\n", who.c_str(),
               errno != 0 ? std::strerror(errno) : "the disk took only a part");
  return code == kExitDone ? kExitFailed : code;
}

// What a library throws beyond its edge, for want of memory or threads, is a failure that is told, not the end of the
// process without a word.
int guarded(const std::string& program, const Verb& verb, int argc, char** argv) {
  try {
    return verb.run(argc, argv);
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "%s %s: not enough memory\n", program.c_str(), std::string(verb.name).c_str());
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s %s: %s\n", program.c_str(), std::string(verb.name).c_str(), printable(e.what()).c_str());
  }
  return kExitFailed;
}

}  // namespace

int dispatch(const Program& program, std::span<const Verb> verbs, int argc, char** argv) {
  hold_standard_streams();
  const std::string name(program.name);
  set_program_name(name);
  if (argc < 2) {
    print_usage(program, verbs, stderr);
    return kExitUsage;
  }
  const std::string_view word = argv[1];
  if (word == "--help" || word == "-h" || word == "help") {
    print_usage(program, verbs, stdout);
    return printed(name, kExitDone);
  }
  if (word == "--version") {
    std::printf("%s " BOLO_VERSION "\n", name.c_str());
    return printed(name, kExitDone);
  }
  for (const Verb& verb : verbs) {
    if (verb.name != word) continue;
    std::signal(SIGXFSZ, SIG_IGN);  // a limit on files is then a full disk: an error of the write, which is told
    return printed(name + " " + std::string(verb.name), guarded(name, verb, argc - 1, argv + 1));
  }
  std::fprintf(stderr, "%s: no verb '%s'; '%s --help' lists them\n", name.c_str(), argv[1], name.c_str());
  return kExitUsage;
}

}  // namespace bolo::tools
