#include "tools/lab/eval/live.hpp"

#include <cstdio>
#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

#include "tools/cli/cli.hpp"
#include "tools/cli/plot_option.hpp"
#include "tools/demo/live_check.hpp"

namespace bolo::tools {
namespace {

constexpr const char* kVerb = "eval live";
constexpr double kLongest_s = 86400.0;

struct Options {
  std::string name;
  std::string truth;
  OutputFile plot;
  double seconds = 10.0;
  bool json = false;
};

Status evaluate(const Options& options) {
  const auto outcome = check_live(options.name, options.truth, options.seconds);
  if (!outcome) return tl::unexpected(outcome.error());
  const nlohmann::ordered_json figures = to_json(*outcome);
  if (options.json) {
    std::printf("%s\n", figures.dump(2).c_str());
  } else {
    print_text(figures);
  }
  if (options.plot.empty()) return {};
  const NamedOutcome only{"deblurred", &*outcome};
  return save(live_sheet({&only, 1}, "bolo-lab eval live"), options.plot);
}

}  // namespace

int eval_live_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval live",
                       "Reads a running daemon's shared memory and compares raw and deblurred planes with the truth of "
                       "the capture that its fake camera replays.");
  cli.add_options()("name", "the daemon's name", cxxopts::value<std::string>())(
      "truth", "the capture with /truth", cxxopts::value<std::string>(), "FILE.h5")(
      "seconds", "how long to read", cxxopts::value<double>()->default_value("10"))("json", "print one JSON object");
  add_plot_option(cli, "draw one frame before and after, and the latency");
  cli.parse_positional({"name"});
  cli.positional_help("NAME");
  cxxopts::ParseResult parsed;
  if (const auto exit = parse(cli, argc, argv, parsed)) return *exit;
  if (parsed.count("name") == 0 || parsed.count("truth") == 0) {
    return report(kVerb, {ErrorKind::kBadInput, "a daemon's NAME and --truth FILE.h5 are needed"});
  }
  const auto plot = plot_file_of(parsed);
  if (!plot) return report(kVerb, plot.error());
  const Options options{parsed["name"].as<std::string>(), parsed["truth"].as<std::string>(), *plot,
                        parsed["seconds"].as<double>(), parsed.count("json") != 0};
  if (!(options.seconds > 0.0 && options.seconds <= kLongest_s)) {
    return report(kVerb, {ErrorKind::kBadInput, "--seconds must lie in 0 to 86400"});
  }
  catch_interrupts();
  if (const auto done = evaluate(options); !done) return report(kVerb, done.error());
  return kExitDone;
}

}  // namespace bolo::tools
