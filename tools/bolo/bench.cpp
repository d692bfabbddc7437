// bolo bench: how fast the deblurring is on this machine, and how near to the optimum; what readers cost the daemon.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <new>
#include <string>

#include <nlohmann/json.hpp>

#include "src/deblur/isa.hpp"
#include "tools/bench/bench_plot.hpp"
#include "tools/bench/cluster_bench.hpp"
#include "tools/bench/deblur_bench.hpp"
#include "tools/bench/readers_bench.hpp"
#include "tools/bolo/cli.hpp"
#include "tools/bolo/plot_option.hpp"
#include "tools/bolo/verbs.hpp"

namespace bolo::tools {
namespace {

cxxopts::Options declare() {
  cxxopts::Options options(
      "bolo bench",
      "Measures on this machine, with 640x120 frames: deblur, the deblurring of one; readers, what\n"
      "processes that read shared memory cost the writer of 200 frames a second; cluster, the pieces that\n"
      "machines would share, and from them how long many machines take for many hours of captures\n");
  options.positional_help("deblur|readers|cluster");
  options.add_options()("what", "deblur, readers or cluster", cxxopts::value<std::string>())(
      "solver", "admm, dual, exact or inverse: of the main figures; cluster: mmae too",
      cxxopts::value<std::string>()->default_value("admm"))(
      "isa", "Instruction set: AVX3 (AVX-512), AVX2, SSE4, SSE2 ... (default: the best)",
      cxxopts::value<std::string>())("threads", "Of the main figures", cxxopts::value<int>()->default_value("1"))(
      "lambda", "Of the main figures, kappa 0.1 (default: the solver's default)", cxxopts::value<double>())(
      "seconds", "How long to measure (default: deblur 5, readers 40, cluster 20)", cxxopts::value<double>())(
      "priority", "SCHED_FIFO priority of the writer with readers; 0: the default scheduler",
      cxxopts::value<int>()->default_value("10"))("json", "Print the result as JSON");
  const auto number = [](const char* value) { return cxxopts::value<double>()->default_value(value); };
  options.add_options("Cluster")("hours", "Of captures, in all", number("1000"))("capture-hours", "Of one capture",
                                                                                 number("1"))(
      "block", "Frames of a block; 0: captures whole (default: as bolo deblur chooses)", cxxopts::value<double>())(
      "cores", "Of a machine", number("32"))("network", "Of a machine, GB/s", number("3"))(
      "storage", "Reading and writing of all machines together, GB/s", number("20"))(
      "price", "Of a core for an hour", number("0.04"))("scratch", "Folder on the disk that is measured",
                                                        cxxopts::value<std::string>()->default_value("."), "FOLDER");
  add_plot_option(options, "Draw the table");
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

std::string cluster_method(const ClusterReport& report) {
  return "one thread, " + std::to_string(report.frames) + " frames of a street, 640x120, in a file; medians of " +
         std::to_string(report.repeats) +
         " rounds. Frames in processor time, a piece from the capture's name to the record on the disk by the clock; "
         "machines by calculation: see CLUSTER.md";
}

void print_json(const ClusterReport& r) {
  nlohmann::json result{{"method", cluster_method(r)},
                        {"solver", r.solver_text},
                        {"repeats", r.repeats},
                        {"deblur_ms", 1e3 * r.costs.deblur_s},
                        {"walk_ms", 1e3 * r.costs.walk_s},
                        {"together_ms", 1e3 * r.costs.together_s},
                        {"piece_ms", 1e3 * r.costs.piece_s},
                        {"rank_zero_us", 1e6 * r.costs.word_s},
                        {"raw_bytes", r.costs.raw_bytes},
                        {"sharp_bytes", r.costs.sharp_bytes},
                        {"disk_write_gb_s", r.write_gb_s},
                        {"disk_read_gb_s", r.read_gb_s},
                        {"hours", r.task.hours},
                        {"capture_hours", r.task.capture_hours}};
  for (std::size_t i = 0; i < r.times.size(); ++i) {
    const ClusterTime& time = r.times[i];
    const ClusterMachines& machines = r.machines[i];
    result["machines"].push_back({{"machines", machines.machines},
                                  {"cores", machines.cores},
                                  {"block_frames", r.block_frames[i]},
                                  {"terabytes", time.terabytes},
                                  {"seconds", time.seconds},
                                  {"compute_s", time.compute_s},
                                  {"storage_s", time.storage_s},
                                  {"walk_s", time.walk_s},
                                  {"rank_zero_s", time.rank_zero_s},
                                  {"together_s", time.together_s},
                                  {"speed_up", time.speed_up},
                                  {"efficiency", time.efficiency},
                                  {"price_per_hour", time.price_per_hour},
                                  {"limit", time.limit}});
  }
  std::puts(result.dump(2).c_str());
}

void print_table(const ClusterReport& r) {
  const PieceCosts& c = r.costs;
  std::printf("%s.\n\n", cluster_method(r).c_str());
  std::printf("%s: %.3f ms a frame", r.solver_text.c_str(), 1e3 * c.deblur_s);
  if (c.walk_s > 0.0) std::printf(", walk %.3f ms", 1e3 * c.walk_s);
  std::printf(", put together %.3f ms; %.0f ms a piece; %.1f us of rank 0 a piece\n", 1e3 * c.together_s,
              1e3 * c.piece_s, 1e6 * c.word_s);
  std::printf("an hour of capture is %.1f core hours; this disk writes %.2f GB/s and reads %.2f GB/s\n\n",
              3600.0 * r.task.rate_hz * (c.deblur_s + c.walk_s + c.together_s) / 3600.0, r.write_gb_s, r.read_gb_s);
  if (r.times.empty()) return;
  const ClusterMachines& m = r.machines.front();
  std::printf(
      "%g hours in captures of %g; machines of %g cores and %g GB/s of network, storage of %g GB/s in all, %g a core "
      "hour\n",
      r.task.hours, r.task.capture_hours, m.cores, m.network_gb_s, m.storage_gb_s, m.price_core_hour);
  std::printf("%8s %10s %8s %12s %10s %10s %10s  %s\n", "machines", "block", "TB", "hours", "speed-up", "efficiency",
              "an hour", "waits for");
  for (std::size_t i = 0; i < r.times.size(); ++i) {
    const ClusterTime& time = r.times[i];
    const std::string block = r.block_frames[i] == 0.0 ? "whole" : std::to_string(std::lround(r.block_frames[i]));
    std::printf("%8g %10s %8.0f %12.3f %10.0f %9.1f%% %10.4f  %s\n", r.machines[i].machines, block.c_str(),
                time.terabytes, time.seconds / 3600.0, time.speed_up, 100.0 * time.efficiency, time.price_per_hour,
                time.limit.c_str());
  }
}

// Prints a report and draws it where a file is named, or passes its error on.
template <typename Report>
Status show(const Result<Report>& report, bool json, const OutputFile& plot) {
  if (!report) return tl::unexpected(report.error());
  if (json) {
    print_json(*report);
  } else {
    print_table(*report);
  }
  if (plot.empty()) return {};
  plot::Sheet sheet = sheet_of(*report);
  sheet.how = machine_words() + ".";
  return save(sheet, plot);
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

// A positive number, or 0 where that means something.
Status read_number(const cxxopts::ParseResult& given, const char* option, bool zero, double& value) {
  value = given[option].as<double>();
  if (value > 0.0 || (zero && value == 0.0)) return {};
  return bad_input(std::string("--") + option + ": expected a number above 0");
}

Result<ClusterBenchOptions> cluster_options(const cxxopts::ParseResult& given) {
  ClusterBenchOptions options;
  deblur::Settings& settings = options.request.options.deblur;
  const auto method = deblur::method_from_name(given["solver"].as<std::string>());
  if (!method) return at("--solver", method.error());
  settings.method = *method;
  if (given.count("lambda") != 0) settings.lambda = given["lambda"].as<double>();
  if (given.count("isa") != 0) {
    if (Status status = deblur::choose_isa(given["isa"].as<std::string>()); !status) return at("--isa", status.error());
  }
  options.request.options.workers = 1;
  options.request.options.output = PixelType::kFloat32;
  options.scratch = given["scratch"].as<std::string>();
  if (given.count("seconds") != 0) options.seconds = given["seconds"].as<double>();
  Status status = read_number(given, "hours", false, options.task.hours);
  if (status) status = read_number(given, "capture-hours", false, options.task.capture_hours);
  options.automatic_block = given.count("block") == 0;
  if (status && !options.automatic_block) status = read_number(given, "block", true, options.task.block_frames);
  if (status) status = read_number(given, "cores", false, options.machines.cores);
  if (status) status = read_number(given, "network", false, options.machines.network_gb_s);
  if (status) status = read_number(given, "storage", false, options.machines.storage_gb_s);
  if (status) status = read_number(given, "price", true, options.machines.price_core_hour);
  if (!status) return tl::unexpected(status.error());
  return options;
}

Status bench(const cxxopts::ParseResult& given) {
  const std::string what = given.count("what") != 0 ? given["what"].as<std::string>() : "";
  const bool json = given.count("json") != 0;
  const auto plot = plot_file_of(given);
  if (!plot) return tl::unexpected(plot.error());
  if (what == "deblur") return show(deblur_options(given).and_then(bench_deblur), json, *plot);
  if (what == "readers") return show(readers_options(given).and_then(bench_readers), json, *plot);
  if (what == "cluster") return show(cluster_options(given).and_then(bench_cluster), json, *plot);
  return bad_input("expected what to measure: bolo bench deblur, bolo bench readers, or bolo bench cluster");
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
