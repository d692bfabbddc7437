// `bolo-lab eval live`: judges a running daemon by what a reader of its shared memory sees.
#include <cstdio>
#include <string>

#include <nlohmann/json.hpp>

#include "tools/demo/live_check.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

Status evaluate(const cxxopts::ParseResult& given) {
  if (given.count("name") == 0 || given.count("truth") == 0) {
    return bad_input("a daemon's NAME and --truth FILE.h5 are needed");
  }
  const double seconds = given["seconds"].as<double>();
  if (Status good = within(seconds, "seconds", 0.001, 86400.0); !good) return good;
  ASSIGN_OR_RETURN(const auto outcome,
                   check_live(given["name"].as<std::string>(), given["truth"].as<std::string>(), seconds));
  const nlohmann::ordered_json figures = to_json(outcome);
  given.count("json") != 0 ? void(std::puts(figures.dump(2).c_str())) : print_text(figures);
  return {};
}

}  // namespace

int eval_live_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval live",
                       "Reads a running daemon's shared memory and compares raw and deblurred planes with the truth of "
                       "the capture that its fake camera replays.");
  cli.add_options()("name", "the daemon's name", cxxopts::value<std::string>())(
      "truth", "the capture with /truth", cxxopts::value<std::string>(), "FILE.h5")(
      "seconds", "how long to read", cxxopts::value<double>()->default_value("10"))("json", "print one JSON object");
  cli.parse_positional({"name"});
  cli.positional_help("NAME");
  return run_verb("eval live", std::move(cli), argc, argv, evaluate);
}

}  // namespace bolo::tools
