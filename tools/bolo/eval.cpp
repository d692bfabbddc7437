// `bolo eval`: measurements of what the deblurring achieves, one file each in tools/lab/eval.
#include <cstdio>
#include <string_view>

#include "tools/bolo/cli.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/lab/eval/evaluations.hpp"

namespace bolo::tools {

int eval_main(int argc, char** argv) {
  const std::string_view word = argc > 1 ? argv[1] : "";
  for (const Verb& evaluation : kEvaluations) {
    if (evaluation.name == word) return evaluation.run(argc - 1, argv + 1);
  }
  const bool help = word == "--help" || word == "-h";
  std::FILE* out = help ? stdout : stderr;
  if (!help) std::fprintf(out, "bolo eval: no evaluation '%s'\n", argc > 1 ? argv[1] : "");
  std::fputs("usage: bolo eval WHAT [options], bolo eval WHAT --help\n\n", out);
  for (const Verb& evaluation : kEvaluations) {
    std::fprintf(out, "  %-10s %s\n", evaluation.name.data(), evaluation.summary.data());
  }
  return help ? kExitDone : kExitUsage;
}

}  // namespace bolo::tools
