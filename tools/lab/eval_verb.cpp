// `bolo-lab eval`: measurements of what the deblurring achieves, one file each in tools/lab/eval.
#include <cstdio>
#include <string_view>

#include "tools/cli/cli.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {

int eval_main(int argc, char** argv) {
  const std::string_view word = argc > 1 ? argv[1] : "";
  for (const Verb& evaluation : kEvaluations) {
    if (evaluation.name == word) return evaluation.run(argc - 1, argv + 1);
  }
  const bool help = word == "--help" || word == "-h";
  std::FILE* out = help ? stdout : stderr;
  if (!help) std::fprintf(out, "bolo-lab eval: no evaluation '%s'\n", argc > 1 ? argv[1] : "");
  std::fputs("usage: bolo-lab eval WHAT [options], bolo-lab eval WHAT --help\n\n", out);
  for (const Verb& evaluation : kEvaluations) {
    std::fprintf(out, "  %-10s %s\n", evaluation.name.data(), evaluation.summary.data());
  }
  return help ? kExitDone : kExitUsage;
}

}  // namespace bolo::tools
