#include "tools/lab/eval/faults.hpp"

#include <cmath>
#include <cstdio>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::faults {
namespace {

constexpr double kTrialRateHz = 200.0;
constexpr double kSpeedPxS = 200.0;
constexpr double kCleanEndS = 0.1;  // without loss, so that every frame that is hit is also judged before the end
constexpr double kSpareS = 1.0;     // the run outlasts its time by what stopping takes

struct SquareSum {
  double squares = 0.0;
  std::size_t values = 0;

  void add(const Counts& shown, const std::vector<float>& truth, const LinearScale& scale) {
    for (std::size_t p = 0; p < truth.size(); ++p) {
      const double error = scale.to_physical(shown[p]) - static_cast<double>(truth[p]);
      squares += error * error;
    }
    values += truth.size();
  }
  double root_mean() const { return values > 0 ? std::sqrt(squares / static_cast<double>(values)) : 0.0; }
};

std::size_t number_of(const Published& frame, double period_s) {
  const double since_first_s = static_cast<double>(frame.meta.camera_ns - kFirstCameraNs) / kNsPerSecond;
  return static_cast<std::size_t>(std::lround(since_first_s / period_s));
}

Result<fakecam::FaultScript> script_of(const LossTask& task) {
  ASSIGN_OR_RETURN(auto fault, fakecam::parse_fault("loss"));
  fault.values["rate"] = task.rate;
  fault.values["for"] = task.seconds - kCleanEndS;
  return fakecam::FaultScript{std::move(fault)};
}

void print_header() {
  std::printf("%8s  %-6s %7s %7s %8s %7s %9s %8s %8s %8s %8s %8s\n", "packets", "asked", "frames", "hit", "network",
              "behind", "frames/s", "ms each", "p50 ms", "p99 ms", "raw K", "sharp K");
}

void print_row(const LossTask& task, const LossRow& row) {
  const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  std::printf("%6.2f %%  %-6s %7llu %7llu %8llu %7llu %9.1f %8.2f %8.2f %8.2f %8.4f %8.4f%s\n", 100.0 * task.rate,
              task.resend ? "again" : "-", n(row.sent), n(row.hit), n(row.network), n(row.behind), row.frames_per_s,
              row.deblur_ms, row.latency_p50_ms, row.latency_p99_ms, row.rmse_raw_k, row.rmse_deblurred_k,
              row.host_dropped > 0 ? "  (this computer dropped packets by itself)" : "");
  std::fflush(stdout);
}

nlohmann::ordered_json to_json(const LossTask& task, const LossRow& row) {
  return {{"rate", task.rate},
          {"resend", task.resend},
          {"packet_size", task.packet_size},
          {"frames_sent", row.sent},
          {"frames_hit", row.hit},
          {"frames_lost", {{"network", row.network}, {"behind", row.behind}}},
          {"deblur_ms_per_frame", row.deblur_ms},
          {"frames_per_s", row.frames_per_s},
          {"latency_ms", {{"p50", row.latency_p50_ms}, {"p99", row.latency_p99_ms}}},
          {"rmse_raw_k", row.rmse_raw_k},
          {"rmse_deblurred_k", row.rmse_deblurred_k},
          {"host_dropped_packets", row.host_dropped}};
}

Status evaluate(const cxxopts::ParseResult& given) {
  const auto rates = given["rates"].as<std::vector<double>>();
  const int packet_size = given["packet-size"].as<int>();
  const double seconds = given["seconds"].as<double>();
  const bool json = given.count("json") != 0;
  pipeline::PipelineOptions pipeline;
  pipeline.deblur.lookahead = given["lookahead"].as<int>();
  pipeline.workers = given["threads"].as<int>();
  const auto [least, most] = std::ranges::minmax(rates);
  RETURN_IF_ERROR(within(least, "rates", 0.0, 1.0));
  RETURN_IF_ERROR(within(most, "rates", 0.0, 1.0));
  RETURN_IF_ERROR(within(packet_size, "packet-size", 576, 9000));
  RETURN_IF_ERROR(within(seconds, "seconds", 0.5, 60.0));
  ASSIGN_OR_RETURN(const auto scene, loss_scene(seconds));
  if (!json) print_header();
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  Progress progress("runs", 2 * rates.size());
  for (const double rate : rates) {
    for (const bool resend : {false, true}) {
      if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
      const LossTask task{rate, resend, packet_size, seconds};
      ASSIGN_OR_RETURN(const auto row, try_loss(task, scene, pipeline));
      if (!json) print_row(task, row);
      rows.push_back(to_json(task, row));
      progress.update(rows.size());
    }
  }
  std::puts(json
                ? nlohmann::ordered_json{{"rows", rows}}.dump(2).c_str()
                : "hit: frames that lost a packet at first. Counted as lost: network (incomplete, missing), behind "
                  "(deblurring\ncould not keep up). ms each: deblurring. Latency: first packet received to published. "
                  "RMSE against the truth\nover the frames that came, those with a lost one in their window included.");
  return {};
}

}  // namespace

Result<Recording> loss_scene(double seconds) {
  sim::CameraSettings camera;
  camera.rate_hz = kTrialRateHz;
  return record_street(
      camera, {.speed_px_s = kSpeedPxS, .frames = static_cast<std::size_t>((seconds + kSpareS) * camera.rate_hz)});
}

Result<LossRow> try_loss(const LossTask& task, const Recording& scene, const pipeline::PipelineOptions& options) {
  ASSIGN_OR_RETURN(auto script, script_of(task));
  RunTask run_task;
  run_task.scene = &scene;
  run_task.faults = std::move(script);
  run_task.camera = camera_options(scene, fresh_address());
  run_task.camera.packet_size = task.packet_size;
  run_task.camera.resend = task.resend;
  run_task.pipeline = options;
  run_task.seconds = task.seconds;
  const auto result = run(run_task);
  if (!result) return tl::unexpected<Error>(result.error());

  LossRow row;
  row.frames_per_s = static_cast<double>(result->frames.size()) / task.seconds;
  row.sent = result->camera.frames_sent;
  row.hit = result->injected.front().frames;
  const auto lost = [&result](LossCause cause) { return result->lost[static_cast<std::size_t>(cause)]; };
  row.network = lost(LossCause::kIncomplete) + lost(LossCause::kMissing);
  row.behind = lost(LossCause::kPoolExhausted) + lost(LossCause::kQueueFull);
  row.deblur_ms = result->deblur_ms;
  row.latency_p50_ms = quantile(result->latency_ms, 0.5);
  row.latency_p99_ms = quantile(result->latency_ms, 0.99);
  row.host_dropped = result->host_dropped;
  SquareSum raw;
  SquareSum deblurred;
  for (const Published& frame : result->frames) {
    const std::size_t number = number_of(frame, scene.format.frame_period_s);
    if ((frame.meta.flags & kFlagWarmUp) != 0 || number >= scene.truth.size()) continue;
    raw.add(frame.raw, scene.truth[number], scene.format.scale);
    deblurred.add(frame.deblurred, scene.truth[number], scene.format.scale);
  }
  row.rmse_raw_k = raw.root_mean();
  row.rmse_deblurred_k = deblurred.root_mean();
  return row;
}

int eval_loss_main(int argc, char** argv) {
  cxxopts::Options options("bolo-lab eval loss",
                           "Streams a street of 640x120 pixels at 200 Hz from a fake camera that loses packets, once\n"
                           "without and once with asking for them again, and judges what is published.\n");
  options.add_options()("rates", "Shares of the packets that are lost, separated by commas",
                        cxxopts::value<std::vector<double>>()->default_value("0,0.001,0.01,0.05"),
                        "A,B")("packet-size", "Bytes: 1500 on every link, up to 9000 with jumbo frames",
                               cxxopts::value<int>()->default_value("1500"),
                               "BYTES")("seconds", "Of each run", cxxopts::value<double>()->default_value("4"), "S")(
      "lookahead", "Frames", cxxopts::value<int>()->default_value("0"), "L")("threads", "Of the deblurring",
                                                                             cxxopts::value<int>()->default_value("2"),
                                                                             "W")("json", "Print the table as JSON");
  return run_verb("eval loss", std::move(options), argc, argv, evaluate);
}

}  // namespace bolo::tools::faults
