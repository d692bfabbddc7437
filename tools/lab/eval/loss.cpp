#include "tools/lab/eval/faults.hpp"

#include <cmath>

#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::faults {
namespace {

constexpr double kTrialRateHz = 200.0;
constexpr double kSpeedPxS = 200.0;
constexpr double kCleanEndS = 0.1;  // without loss, so that every frame that is hit is also judged before the end
constexpr double kSpareS = 1.0;     // the run outlasts its time by what stopping takes

void add(SquareSum& sum, const Counts& shown, const std::vector<float>& truth, const LinearScale& scale) {
  for (std::size_t p = 0; p < truth.size(); ++p) {
    sum.add(scale.to_physical(shown[p]), static_cast<double>(truth[p]));
  }
}

std::size_t frame_number(const Published& frame, double period_s) {
  const double since_first_s = static_cast<double>(frame.meta.camera_ns - kFirstCameraNs) / kNsPerSecond;
  return static_cast<std::size_t>(std::lround(since_first_s / period_s));
}

Result<fakecam::FaultScript> script_of(const LossTask& task) {
  ASSIGN_OR_RETURN(auto fault, fakecam::parse_fault("loss"));
  fault.values["rate"] = task.rate;
  fault.values["for"] = task.seconds - kCleanEndS;
  return fakecam::FaultScript{std::move(fault)};
}

const std::vector<TextColumn> kColumns{{"packets", 8, "rate", "%.2f %%", 100.0},
                                       {"resend", -6, "resend"},
                                       {"frames", 7, "frames_sent", "%.0f"},
                                       {"hit", 7, "frames_hit", "%.0f"},
                                       {"network", 8, "frames_lost/network", "%.0f"},
                                       {"behind", 7, "frames_lost/behind", "%.0f"},
                                       {"frames/s", 9, "frames_per_s", "%.1f"},
                                       {"ms each", 8, "deblur_ms_per_frame", "%.2f"},
                                       {"p50 ms", 8, "latency_ms/p50", "%.2f"},
                                       {"p99 ms", 8, "latency_ms/p99", "%.2f"},
                                       {"raw K", 8, "rmse_raw_k", "%.4f"},
                                       {"sharp K", 8, "rmse_deblurred_k", "%.4f"},
                                       {"dropped here", 12, "host_dropped_packets", "%.0f"}};

Status evaluate(const cxxopts::ParseResult& given) {
  const auto rates = given["rates"].as<std::vector<double>>();
  pipeline::PipelineOptions pipeline;
  pipeline.deblur.lookahead = given["lookahead"].as<int>();
  pipeline.workers = given["threads"].as<int>();
  for (const double rate : rates) RETURN_IF_ERROR(within(rate, "rates", 0.0, 1.0));
  ASSIGN_OR_RETURN(const int packet_size, number_of<int>(given, "packet-size", 576, 9000));
  ASSIGN_OR_RETURN(const double seconds, number_of<double>(given, "seconds", 0.5, 60.0));
  ASSIGN_OR_RETURN(const auto scene, loss_scene(seconds));
  Rows rows(given.count("json") != 0, kColumns);
  Progress progress("runs", 2 * rates.size());
  for (const double rate : rates) {
    for (const bool resend : {false, true}) {
      if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
      ASSIGN_OR_RETURN(auto row, try_loss({rate, resend, packet_size, seconds}, scene, pipeline));
      rows.add(std::move(row));
      progress.update(rows.count());
    }
  }
  rows.finish({}, "rows",
              "hit: frames that lost a packet at first. Counted as lost: network (incomplete, missing), behind "
              "(deblurring\ncould not keep up). ms each: deblurring. Latency: first packet received to published. RMSE "
              "against the truth\nover the frames that came, those with a lost one in their window included. dropped "
              "here: packets, by this computer.");
  return {};
}

}  // namespace

Result<Recording> loss_scene(double seconds) {
  sim::CameraSettings camera;
  camera.rate_hz = kTrialRateHz;
  return record_street(
      camera, {.speed_px_s = kSpeedPxS, .frames = static_cast<std::size_t>((seconds + kSpareS) * camera.rate_hz)});
}

Result<Json> try_loss(const LossTask& task, const Recording& scene, const pipeline::PipelineOptions& options) {
  RunTask run_task;
  run_task.scene = &scene;
  ASSIGN_OR_RETURN(run_task.faults, script_of(task));
  run_task.camera = camera_options(scene, fresh_address());
  run_task.camera.packet_size = task.packet_size;
  run_task.camera.resend = task.resend;
  run_task.pipeline = options;
  run_task.seconds = task.seconds;
  ASSIGN_OR_RETURN(const auto result, run(run_task));
  SquareSum raw;
  SquareSum deblurred;
  for (const Published& frame : result.frames) {
    const std::size_t number = frame_number(frame, scene.format.frame_period_s);
    if ((frame.meta.flags & kFlagWarmUp) != 0 || number >= scene.truth.size()) continue;
    add(raw, frame.raw, scene.truth[number], scene.format.scale);
    add(deblurred, frame.deblurred, scene.truth[number], scene.format.scale);
  }
  const auto lost = [&result](LossCause cause) { return result.lost[static_cast<std::size_t>(cause)]; };
  return Json{{"rate", task.rate},
              {"resend", task.resend},
              {"packet_size", task.packet_size},
              {"frames_sent", result.camera.frames_sent},
              {"frames_hit", result.injected.front().frames},
              {"frames_lost",
               {{"network", lost(LossCause::kIncomplete) + lost(LossCause::kMissing)},
                {"behind", lost(LossCause::kPoolExhausted) + lost(LossCause::kQueueFull)}}},
              {"deblur_ms_per_frame", result.deblur_ms},
              {"frames_per_s", static_cast<double>(result.frames.size()) / task.seconds},
              {"latency_ms", {{"p50", quantile(result.latency_ms, 0.5)}, {"p99", quantile(result.latency_ms, 0.99)}}},
              {"rmse_raw_k", raw.root_mean()},
              {"rmse_deblurred_k", deblurred.root_mean()},
              {"host_dropped_packets", result.host_dropped}};
}

int eval_loss_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval loss",
                       "Streams a street of 640x120 pixels at 200 Hz from a fake camera that loses packets, once\n"
                       "without and once with asking for them again, and judges what is published.\n");
  add_option<std::vector<double>>(cli, "rates", "Shares of the packets that are lost, separated by commas",
                                  "0,0.001,0.01,0.05", "A,B");
  add_option<int>(cli, "packet-size", "Bytes: 1500 on every link, up to 9000 with jumbo frames", "1500", "BYTES");
  add_option<double>(cli, "seconds", "Of each run", "4", "S");
  add_option<int>(cli, "lookahead", "Frames", "0", "L");
  add_option<int>(cli, "threads", "Of the deblurring", "2", "W");
  add_option<bool>(cli, "json", "Print the table as JSON");
  return run_verb("eval loss", std::move(cli), argc, argv, evaluate);
}

}  // namespace bolo::tools::faults
