// bolo-lab bench: how fast the deblurring is on this machine, and how near to the optimum; what readers cost the
// daemon.
#include <cstdio>

#include "tools/lab/bench/bench.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

Status bench(const cxxopts::ParseResult& given) {
  const std::string what = given.count("what") != 0 ? given["what"].as<std::string>() : "";
  const auto seconds = [&given](double standard) {
    return given.count("seconds") != 0 ? given["seconds"].as<double>() : standard;
  };
  if (what != "deblur" && what != "readers") {
    return bad_input("expected what to measure: bolo-lab bench deblur or bolo-lab bench readers");
  }
  Json report;
  if (what == "deblur") {
    BenchOptions options{given["solver"].as<std::string>(), "", given["threads"].as<int>(), -1.0, seconds(5.0)};
    if (given.count("isa") != 0) options.isa = given["isa"].as<std::string>();
    if (given.count("lambda") != 0) options.lambda = given["lambda"].as<double>();
    if (given.count("lambda") != 0 && !(options.lambda >= 0.0)) return bad_input("--lambda: expected 0 or more");
    ASSIGN_OR_RETURN(report, bench_deblur(options));
  } else {
    ASSIGN_OR_RETURN(const int priority, number_of<int>(given, "priority", 0, 99));
    ASSIGN_OR_RETURN(report, bench_readers(seconds(40.0), priority));
  }
  print_report(report, given.count("json") != 0);
  return {};
}

}  // namespace

int lab_bench_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo-lab bench",
      "Measures on this machine, with 640x120 frames: deblur, the deblurring of one; readers, what\n"
      "processes that read shared memory cost the writer of 200 frames a second.\n"
      "deblur: a window of 17 frames of a street at 300 px/s, 30 mK of noise. The repeats of all variants\n"
      "take turns; errors are against exact on 2560 pixels, on which alone exact is timed. profile: with\n"
      "maps of gain, offset, time constant and dead pixels (0.5 %), and a row delay. lost_frames: every\n"
      "other one before the newest, those that cost the most. throughput_of_plain: frames a second, of\n"
      "those without both.\n");
  cli.positional_help("deblur|readers");
  add_option<std::string>(cli, "what", "deblur or readers");
  add_option<std::string>(cli, "solver", "admm, dual, exact or inverse: of the main figures", "admm");
  add_option<std::string>(cli, "isa", "Instruction set: AVX3 (AVX-512), AVX2, SSE4, SSE2 ... (default: the best)");
  add_option<int>(cli, "threads", "Of the main figures", "1");
  add_option<double>(cli, "lambda", "Of the main figures, kappa 0.1 (default: the solver's default)");
  add_option<double>(cli, "seconds", "How long to measure (default: deblur 5, readers 40)");
  add_option<int>(cli, "priority", "SCHED_FIFO priority of the writer with readers; 0: the default scheduler", "10");
  add_option<bool>(cli, "json", "Print the result as JSON");
  cli.parse_positional({"what"});
  return run_verb("bench", std::move(cli), argc, argv, bench, false);
}

}  // namespace bolo::tools
