// `bolo nuc`: triggers a NUC of a running daemon's camera.
#include <cstdio>
#include <string>

#include "tools/bolo/control_client.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {

int nuc_main(int argc, char** argv) {
  cxxopts::Options cli("bolo nuc", "Make a running daemon's camera correct its pixels (NUC) now.");
  add_option<std::string>(cli, "name", "The daemon's name");
  add_option<bool>(cli, "json", "Print the daemon's answer");
  cli.parse_positional({"name"});
  cli.positional_help("NAME");
  const auto ask = [](const cxxopts::ParseResult& given) -> Status {
    const bool json = given.count("json") != 0;
    if (given.count("name") == 0) return bad_input("NAME is missing: bolo nuc NAME");
    ASSIGN_OR_RETURN(const auto answer, ask_daemon_named(given["name"].as<std::string>(), "nuc"));
    if (json) std::puts(answer.c_str());
    RETURN_IF_ERROR(judge_answer(answer));
    if (!json) std::puts("the camera corrects its pixels");
    return {};
  };
  return run_verb("nuc", std::move(cli), argc, argv, ask, false);
}

}  // namespace bolo::tools
