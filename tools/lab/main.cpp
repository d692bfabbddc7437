// `bolo-lab`: measures and tests Bolo itself, and `bolo-lab eval live`; never installed, never needed by bolo or bolod.
#include "tools/demo/live_check.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

Status evaluate_live(const cxxopts::ParseResult& given) {
  if (given.count("name") == 0 || given.count("truth") == 0) {
    return bad_input("a daemon's NAME and --truth FILE.h5 are needed");
  }
  ASSIGN_OR_RETURN(const double seconds, number_of<double>(given, "seconds", 0.001, 86400.0));
  ASSIGN_OR_RETURN(const auto outcome,
                   check_live(given["name"].as<std::string>(), given["truth"].as<std::string>(), seconds));
  print_report(to_json(outcome), given.count("json") != 0);
  return {};
}

}  // namespace

int eval_live_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval live",
                       "Reads a running daemon's shared memory and compares raw and deblurred planes with the truth of "
                       "the capture that its fake camera replays.");
  add_option<std::string>(cli, "name", "the daemon's name");
  add_option<std::string>(cli, "truth", "the capture with /truth", nullptr, "FILE.h5");
  add_option<double>(cli, "seconds", "how long to read", "10");
  add_option<bool>(cli, "json", "print one JSON object");
  cli.parse_positional({"name"});
  cli.positional_help("NAME");
  return run_verb("live", std::move(cli), argc, argv, evaluate_live);
}

int eval_main(int argc, char** argv) {
  return dispatch({"bolo-lab eval", "measurements of what the deblurring achieves"}, kEvaluations, argc, argv);
}

}  // namespace bolo::tools

int main(int argc, char** argv) {
  return bolo::tools::dispatch({"bolo-lab", "the laboratory: what Bolo achieves, measured"}, bolo::tools::kLabVerbs,
                               argc, argv);
}
