#include "tools/lab/eval/loss_trial.hpp"

#include <cmath>

#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"

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
  auto fault = fakecam::parse_fault("loss");
  if (!fault) return tl::unexpected<Error>(fault.error());
  fault->values["rate"] = task.rate;
  fault->values["for"] = task.seconds - kCleanEndS;
  return fakecam::FaultScript{std::move(*fault)};
}

}  // namespace

Result<Recording> loss_scene(double seconds) {
  sim::CameraSettings camera;
  camera.rate_hz = kTrialRateHz;
  return record_street(
      camera, {.speed_px_s = kSpeedPxS, .frames = static_cast<std::size_t>((seconds + kSpareS) * camera.rate_hz)});
}

Result<LossRow> try_loss(const LossTask& task, const Recording& scene, const pipeline::PipelineOptions& options) {
  auto script = script_of(task);
  if (!script) return tl::unexpected<Error>(script.error());
  RunTask run_task;
  run_task.scene = &scene;
  run_task.faults = std::move(*script);
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

}  // namespace bolo::tools::faults
