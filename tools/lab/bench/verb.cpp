// bolo-lab bench: how fast the deblurring is on this machine, and how near to the optimum; what readers cost the
// daemon.
#include <cstdio>

#include "tools/lab/bench/bench.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

const std::vector<TextColumn> kDeblurColumns{{"solver", -8, "solver"},
                                             {"isa", -7, "isa"},
                                             {"thr", 3, "threads"},
                                             {"prof", -4, "profile"},
                                             {"lost", 4, "lost_frames"},
                                             {"lambda/2k", 9, "lambda_half"},
                                             {"iter", 5, "iterations"},
                                             {"min ms", 10, "ms_per_frame", "%.3f"},
                                             {"median ms", 10, "median_ms_per_frame", "%.3f"},
                                             {"ns/pixel", 9, "ns_per_pixel", "%.2f"},
                                             {"rms mK", 9, "rms_error_k", "%.2f", 1e3},
                                             {"max mK", 9, "max_error_k", "%.2f", 1e3},
                                             {"realtime", 9, "realtime_factor", "%.2f"},
                                             {"scaling", 7, "scaling", "%.2f"},
                                             {"of plain", 8, "throughput_of_plain", "%.2f"}};

const std::vector<TextColumn> kReadersColumns{{"readers", 7, "readers"},
                                              {"rate Hz", 9, "rate_hz", "%.3f"},
                                              {"publish p50", 11, "publish_us_p50", "%.1f us"},
                                              {"publish p99", 11, "publish_us_p99", "%.1f us"},
                                              {"due p99", 9, "due_us_p99", "%.0f us"},
                                              {"| rate", 10, "rate_ratio", "x %.4f"},
                                              {"publish p99", 11, "publish_p99_ratio", "x %.2f"},
                                              {"due p99", 9, "due_p99_ratio", "x %.2f"},
                                              {"read", 8, "read_fraction", "%.1f%%", 100.0}};

void print_deblur(const Json& report) {
  std::printf(
      "One 640x120 frame, window of 17: a street panning at 300 px/s, 30 mK of noise, 10 mK a count.\n"
      "Repeats of all variants in turn; errors against exact on 2560 pixels at the same lambda.\n"
      "exact is timed on 2560 pixels, scaled.\n"
      "prof: with maps of gain, offset, time constant and dead pixels (0.5 %%), and a row delay.\n"
      "lost: so many are missing, every other one before the newest: those that cost the most. of plain: frames a "
      "second, of those without both.\n"
      "Machine: %d processors.\n\n",
      report["machine"]["processors"].get<int>());
  std::printf("%s\n%s\n\n", line_of(kDeblurColumns).c_str(), line_of(kDeblurColumns, report).c_str());
  for (const Json& variant : report["variants"]) std::puts(line_of(kDeblurColumns, variant).c_str());
}

void print_readers(const Json& report) {
  std::printf(
      "%s.\n"
      "publish: the call that publishes a frame. due: from when the frame was due until it was published.\n"
      "read: of all frames, by readers that nothing was done to.\n\n%s\n",
      report["method"].get<std::string>().c_str(), line_of(kReadersColumns).c_str());
  for (const Json& row : report["cases"]) std::puts(line_of(kReadersColumns, row).c_str());
}

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
  if (given.count("json") != 0) {
    std::puts(report.dump(2).c_str());
  } else {
    what == "deblur" ? print_deblur(report) : print_readers(report);
  }
  return {};
}

}  // namespace

int lab_bench_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab bench",
                       "Measures on this machine, with 640x120 frames: deblur, the deblurring of one; readers, what\n"
                       "processes that read shared memory cost the writer of 200 frames a second\n");
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
