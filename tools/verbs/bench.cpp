// bolo bench: how fast the deblurring is on this machine, and how near to the optimum.
#include <cstdio>
#include <new>
#include <string>

#include <nlohmann/json.hpp>

#include "tools/bench/deblur_bench.hpp"
#include "tools/verbs/cli.hpp"
#include "tools/verbs/verbs.hpp"

namespace bolo::tools {
namespace {

cxxopts::Options declare() {
  cxxopts::Options options("bolo bench", "Measures the deblurring of a 640x120 frame on this machine");
  options.positional_help("deblur");
  options.add_options()("what", "deblur", cxxopts::value<std::string>())(
      "solver", "admm, dual, exact or inverse: of the main figures",
      cxxopts::value<std::string>()->default_value("admm"))(
      "isa", "Instruction set: AVX3 (AVX-512), AVX2, SSE4, SSE2 ... (default: the best)",
      cxxopts::value<std::string>())("threads", "Of the main figures", cxxopts::value<int>()->default_value("1"))(
      "lambda", "Of the main figures, kappa 0.1 (default: the solver's default)", cxxopts::value<double>())(
      "seconds", "How long to measure", cxxopts::value<double>()->default_value("5"))("json",
                                                                                      "Print the result as JSON");
  options.parse_positional({"what"});
  return options;
}

nlohmann::json to_json(const Measured& m) {
  return {{"solver", m.solver},
          {"isa", m.isa},
          {"threads", m.threads},
          {"profile", m.profile},
          {"iterations", m.iterations},
          {"lambda_half", m.lambda_half_k},
          {"pixels", m.pixels},
          {"repeats", m.repeats},
          {"ms_per_frame", m.ms_per_frame},
          {"median_ms_per_frame", m.median_ms_per_frame},
          {"ns_per_pixel", m.ns_per_pixel},
          {"rms_error_k", m.rms_error_k},
          {"max_error_k", m.max_error_k},
          {"realtime_factor", m.realtime_factor},
          {"scaling", m.scaling},
          {"throughput_of_plain", m.of_plain},
          {"fma_fraction", m.fma_fraction},
          {"read_fraction", m.read_fraction}};
}

void print_json(const BenchReport& report) {
  nlohmann::json result = to_json(report.main);
  result["machine"] = {{"processors", report.processors},
                       {"read_gb_per_s", report.machine.read_gb_per_s},
                       {"fma_gflop_per_s", report.machine.fma_gflop_per_s}};
  for (const Measured& variant : report.variants) result["variants"].push_back(to_json(variant));
  std::puts(result.dump(2).c_str());
}

void print_row(const Measured& m) {
  std::printf("%-8s %-7s %3d %-4s %9g %5d %10.3f %10.3f %9.2f %9.2f %9.2f %9.2f %7.2f %6.0f%%", m.solver.c_str(),
              m.isa.c_str(), m.threads, m.profile ? "yes" : "", m.lambda_half_k, m.iterations, m.ms_per_frame,
              m.median_ms_per_frame, m.ns_per_pixel, 1e3 * m.rms_error_k, 1e3 * m.max_error_k, m.realtime_factor,
              m.scaling, 100.0 * m.fma_fraction);
  if (m.profile) std::printf("  %.2f of the frames without", m.of_plain);
  std::puts("");
}

void print_table(const BenchReport& report) {
  std::printf("One 640x120 frame, window of 17: a street panning at 300 px/s, 30 mK of noise, 10 mK a count.\n");
  std::printf("Repeats of all variants in turn; errors against exact on 2560 pixels at the same lambda.\n");
  std::printf("of fma: operations counted in the algorithm, of the multiply-adds below. ");
  std::printf("naive is dense ADMM on 128 unknowns (640 pixels, scaled); exact is timed on 2560 pixels, scaled.\n");
  std::printf("prof: with maps of gain, offset, time constant and dead pixels (0.5 %%), and a row delay.\n");
  std::printf("Machine: %d processors; one thread reads %.1f GB/s and does %.0f GFLOP/s of multiply-adds.\n\n",
              report.processors, report.machine.read_gb_per_s, report.machine.fma_gflop_per_s);
  std::printf("%-8s %-7s %3s %-4s %9s %5s %10s %10s %9s %9s %9s %9s %7s %7s\n", "solver", "isa", "thr", "prof",
              "lambda/2k", "iter", "min ms", "median ms", "ns/pixel", "rms mK", "max mK", "realtime", "scaling",
              "of fma");
  print_row(report.main);
  std::puts("");
  for (const Measured& variant : report.variants) print_row(variant);
}

Status bench(const cxxopts::ParseResult& given) {
  const std::string what = given.count("what") != 0 ? given["what"].as<std::string>() : "";
  if (what != "deblur") return bad_input("expected what to measure: bolo bench deblur");
  BenchOptions options;
  options.solver = given["solver"].as<std::string>();
  if (given.count("isa") != 0) options.isa = given["isa"].as<std::string>();
  options.threads = given["threads"].as<int>();
  if (given.count("lambda") != 0) {
    options.lambda = given["lambda"].as<double>();
    if (!(options.lambda >= 0.0)) return bad_input("--lambda: expected 0 or more");
  }
  options.seconds = given["seconds"].as<double>();
  const auto report = bench_deblur(options);
  if (!report) return tl::unexpected(report.error());
  if (given.count("json") != 0) {
    print_json(*report);
  } else {
    print_table(*report);
  }
  return {};
}

}  // namespace

int bench_main(int argc, char** argv) {
  cxxopts::Options options = declare();
  cxxopts::ParseResult given;
  if (const auto code = parse(options, argc, argv, given)) return *code;
  try {
    const Status status = bench(given);
    return status ? kExitDone : report("bench", status.error());
  } catch (const std::bad_alloc&) {
    return report("bench", Error{ErrorKind::kFailed, "not enough memory"});
  }
}

}  // namespace bolo::tools
