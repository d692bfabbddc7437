// bolo-lab bench: how fast the deblurring is on this machine, and how near to the optimum; what readers cost the
// daemon.
#include <cstdio>
#include <new>
#include <string>

#include <nlohmann/json.hpp>

#include "tools/cli/cli.hpp"
#include "tools/lab/bench/deblur_bench.hpp"
#include "tools/lab/bench/readers_bench.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

cxxopts::Options declare() {
  cxxopts::Options options(
      "bolo-lab bench",
      "Measures on this machine, with 640x120 frames: deblur, the deblurring of one; readers, what\n"
      "processes that read shared memory cost the writer of 200 frames a second\n");
  options.positional_help("deblur|readers");
  options.add_options()("what", "deblur or readers", cxxopts::value<std::string>())(
      "solver", "admm, dual, exact or inverse: of the main figures",
      cxxopts::value<std::string>()->default_value("admm"))(
      "isa", "Instruction set: AVX3 (AVX-512), AVX2, SSE4, SSE2 ... (default: the best)",
      cxxopts::value<std::string>())("threads", "Of the main figures", cxxopts::value<int>()->default_value("1"))(
      "lambda", "Of the main figures, kappa 0.1 (default: the solver's default)", cxxopts::value<double>())(
      "seconds", "How long to measure (default: deblur 5, readers 40)", cxxopts::value<double>())(
      "priority", "SCHED_FIFO priority of the writer with readers; 0: the default scheduler",
      cxxopts::value<int>()->default_value("10"))("json", "Print the result as JSON");
  options.parse_positional({"what"});
  return options;
}

nlohmann::json to_json(const Measured& m) {
  return {{"solver", m.solver},
          {"isa", m.isa},
          {"threads", m.threads},
          {"profile", m.profile},
          {"lost_frames", m.lost},
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
          {"throughput_of_plain", m.of_plain}};
}

void print_json(const BenchReport& report) {
  nlohmann::json result = to_json(report.main);
  result["machine"] = {{"processors", report.processors}};
  for (const Measured& variant : report.variants) result["variants"].push_back(to_json(variant));
  std::puts(result.dump(2).c_str());
}

void print_row(const Measured& m) {
  std::printf("%-8s %-7s %3d %-4s %4d %9g %5d %10.3f %10.3f %9.2f %9.2f %9.2f %9.2f %7.2f", m.solver.c_str(),
              m.isa.c_str(), m.threads, m.profile ? "yes" : "", m.lost, m.lambda_half_k, m.iterations, m.ms_per_frame,
              m.median_ms_per_frame, m.ns_per_pixel, 1e3 * m.rms_error_k, 1e3 * m.max_error_k, m.realtime_factor,
              m.scaling);
  if (m.profile || m.lost > 0) std::printf("  %.2f of the frames without", m.of_plain);
  std::puts("");
}

void print_table(const BenchReport& report) {
  std::printf("One 640x120 frame, window of 17: a street panning at 300 px/s, 30 mK of noise, 10 mK a count.\n");
  std::printf("Repeats of all variants in turn; errors against exact on 2560 pixels at the same lambda.\n");
  std::printf("exact is timed on 2560 pixels, scaled.\n");
  std::printf("prof: with maps of gain, offset, time constant and dead pixels (0.5 %%), and a row delay.\n");
  std::printf("lost: so many frames are missing, every other one before the newest: those that cost the most.\n");
  std::printf("Machine: %d processors.\n\n", report.processors);
  std::printf("%-8s %-7s %3s %-4s %4s %9s %5s %10s %10s %9s %9s %9s %9s %7s\n", "solver", "isa", "thr", "prof", "lost",
              "lambda/2k", "iter", "min ms", "median ms", "ns/pixel", "rms mK", "max mK", "realtime", "scaling");
  print_row(report.main);
  std::puts("");
  for (const Measured& variant : report.variants) print_row(variant);
}

// How it was measured; `realtime`: whether the writer had its priority.
std::string readers_method(const ReadersReport& report) {
  return "one writer of 640x120 frames at 200 Hz (" +
         std::string(report.realtime ? "SCHED_FIFO" : "default scheduler") + ", " + std::to_string(report.processors) +
         " processors); readers are processes that copy every frame through libbolo-client. Of 4 and 16 readers one is "
         "stopped, one killed while they read, one reads a tenth. Phases of " +
         std::to_string(report.frames_per_phase) + " frames in turn, " + std::to_string(report.rounds) +
         " rounds: medians; ratios within a round to its phase without readers";
}

nlohmann::json to_json(const ReadersMeasured& m) {
  return {{"readers", m.readers},
          {"frozen", m.frozen},
          {"killed", m.killed},
          {"slow", m.slow},
          {"rate_hz", m.rate_hz},
          {"publish_us_p50", m.publish_us_p50},
          {"publish_us_p99", m.publish_us_p99},
          {"due_us_p99", m.due_us_p99},
          {"rate_ratio", m.rate_ratio},
          {"publish_p99_ratio", m.publish_p99_ratio},
          {"due_p99_ratio", m.due_p99_ratio},
          {"read_fraction", m.read_fraction}};
}

void print_json(const ReadersReport& report) {
  nlohmann::json result{{"method", readers_method(report)},
                        {"rounds", report.rounds},
                        {"frames_per_phase", report.frames_per_phase},
                        {"processors", report.processors},
                        {"realtime", report.realtime}};
  for (const ReadersMeasured& m : report.cases) result["cases"].push_back(to_json(m));
  std::puts(result.dump(2).c_str());
}

void print_table(const ReadersReport& report) {
  std::printf("%s.\n", readers_method(report).c_str());
  std::printf("publish: the call that publishes a frame. due: from when the frame was due until it was published.\n");
  std::printf("read: of all frames, by readers that nothing was done to.\n\n");
  std::printf("%7s %9s %11s %11s %9s | %9s %11s %9s %8s\n", "readers", "rate Hz", "publish p50", "publish p99",
              "due p99", "rate", "publish p99", "due p99", "read");
  for (const ReadersMeasured& m : report.cases) {
    std::printf("%7d %9.3f %8.1f us %8.1f us %6.0f us | x %7.4f x %9.2f x %7.2f %7.1f%%\n", m.readers, m.rate_hz,
                m.publish_us_p50, m.publish_us_p99, m.due_us_p99, m.rate_ratio, m.publish_p99_ratio, m.due_p99_ratio,
                100.0 * m.read_fraction);
  }
}

// Prints a report, or passes its error on.
template <typename Report>
Status show(const Result<Report>& report, bool json) {
  if (!report) return tl::unexpected(report.error());
  json ? print_json(*report) : print_table(*report);
  return {};
}

Result<BenchOptions> deblur_options(const cxxopts::ParseResult& given) {
  BenchOptions options;
  options.solver = given["solver"].as<std::string>();
  if (given.count("isa") != 0) options.isa = given["isa"].as<std::string>();
  options.threads = given["threads"].as<int>();
  if (given.count("lambda") != 0) {
    options.lambda = given["lambda"].as<double>();
    if (!(options.lambda >= 0.0)) return bad_input("--lambda: expected 0 or more");
  }
  if (given.count("seconds") != 0) options.seconds = given["seconds"].as<double>();
  return options;
}

Result<ReadersOptions> readers_options(const cxxopts::ParseResult& given) {
  ReadersOptions options;
  options.priority = given["priority"].as<int>();
  if (options.priority < 0 || options.priority > 99) return bad_input("--priority: expected 1 to 99, or 0 for none");
  if (given.count("seconds") != 0) options.seconds = given["seconds"].as<double>();
  return options;
}

Status bench(const cxxopts::ParseResult& given) {
  const std::string what = given.count("what") != 0 ? given["what"].as<std::string>() : "";
  const bool json = given.count("json") != 0;
  if (what == "deblur") return show(deblur_options(given).and_then(bench_deblur), json);
  if (what == "readers") return show(readers_options(given).and_then(bench_readers), json);
  return bad_input("expected what to measure: bolo-lab bench deblur or bolo-lab bench readers");
}

}  // namespace

int lab_bench_main(int argc, char** argv) {
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
