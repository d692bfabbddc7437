// `bolo nuc`: has a running daemon's camera correct its pixels now.
#include <cstdio>
#include <string>

#include "tools/bolo/control_client.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {

int nuc_main(int argc, char** argv) {
  cxxopts::Options cli("bolo nuc", "Have a running daemon's camera correct its pixels (NUC) now.");
  std::string name;
  bool json = false;
  cli.add_options()("name", "The daemon's name", cxxopts::value(name))("json", "Print the daemon's answer",
                                                                       cxxopts::value(json));
  cli.parse_positional({"name"});
  cli.positional_help("NAME");
  cxxopts::ParseResult parsed;
  if (const auto code = parse(cli, argc, argv, parsed)) return *code;
  if (name.empty()) return report("nuc", {ErrorKind::kBadInput, "NAME is missing: bolo nuc NAME"});
  const auto answer = ask_daemon_named(name, "nuc");
  if (!answer) return report("nuc", answer.error());
  if (json) std::puts(answer->c_str());
  if (const Status done = judge_answer(*answer); !done) return report("nuc", done.error());
  if (!json) std::puts("the camera corrects its pixels");
  return kExitDone;
}

}  // namespace bolo::tools
