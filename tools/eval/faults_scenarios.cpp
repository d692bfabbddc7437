#include "tools/eval/faults_scenarios.hpp"

#include <sstream>

namespace bolo::tools::faults {
namespace {

constexpr Geometry kGeometry{64, 24};
constexpr double kRateHz = 200.0;
constexpr double kSeconds = 5.0;  // of the scene: longer than any stream
constexpr int kTries = 3;

void ask_for_resends(RunTask& task) { task.camera.resend = true; }

std::vector<Scenario> make_scenarios() {
  return {
      {"loss", "loss:at=0.3,for=0.3,rate=0.05", 0.9, {0.3, 0.6}},
      {"loss, resent", "loss:at=0.3,for=0.3,rate=0.05", 0.9, {0.3, 0.6}, true, 0, 0, ask_for_resends},
      {"loss, unanswered",
       "loss:at=0.3,for=0.3,rate=0.05 resend_unanswered",
       0.9,
       {0.3, 0.6},
       false,
       0,
       0,
       ask_for_resends},
      {"reorder", "reorder:at=0.3,for=0.3,rate=0.3,by=3", 0.9, {0.3, 0.6}},
      {"duplicate", "duplicate:at=0.3,for=0.3,rate=0.3", 0.9, {0.3, 0.6}},
      {"garbage", "garbage:at=0.3,for=0.3,rate=0.05", 0.9, {0.3, 0.6}},
      {"id gap", "id_gap:at=0.3,ids=7", 0.7, {0.3, 0.3}},
      {"time jump", "time_jump:at=0.3,by=0.5", 0.7, {0.3, 0.3, 0.5}},
      {"time jump back", "time_jump:at=0.3,by=-0.5", 0.7, {0.3, 0.3, -0.5}},
      {"short stall", "stall:at=0.3,frames=5", 0.7, {0.3, 0.325}},
      {"stall", "stall:at=0.3,for=0.3", 1.0, {0.3, 0.6}},
      {"freeze", "freeze:at=0.3,for=0.3", 1.0, {0.3, 0.6}},
      {"control loss", "control_loss:at=0.3", 3.0, {0.3, 0.3}, false, 1, 1},
      {"reboot", "reboot:at=0.3,for=0.5", 4.5, {0.3, 0.8}, false, 1, 2},
      {"nuc",
       "nuc:at=0.3,for=0.3,offset=0.5",
       1.0,
       {0.3, 0.6, 0.0, 50},
       false,
       0,
       0,
       [](RunTask& task) { task.pipeline.undo.drop_repeated = true; }},
      {"byte order",
       "byte_order",
       0.5,
       {},
       false,
       0,
       0,
       [](RunTask& task) { task.camera.pixel_order = genicam::PixelOrder::kBigEndian; }},
      {"metadata rows",
       "metadata_rows:rows=3",
       0.5,
       {},
       false,
       0,
       0,
       [](RunTask& task) {
         task.rows_below = 3;
         task.camera.metadata_rows = 3;
       }},
      {"windowing drop", "windowing_drop:for=0.5", 0.5, {}},
  };
}

Result<fakecam::FaultScript> script_of(const std::string& texts) {
  fakecam::FaultScript script;
  std::istringstream words(texts);
  for (std::string text; words >> text;) {
    auto fault = fakecam::parse_fault(text);
    if (!fault) return tl::unexpected<Error>(fault.error());
    script.push_back(std::move(*fault));
  }
  return script;
}

}  // namespace

const std::vector<Scenario>& scenarios() {
  static const std::vector<Scenario> kScenarios = make_scenarios();
  return kScenarios;
}

Result<Stage> make_stage() {
  sim::CameraSettings camera;
  camera.geometry = kGeometry;
  camera.rate_hz = kRateHz;
  camera.threads = 1;
  auto scene = record_street(camera, {.frames = static_cast<std::size_t>(kSeconds * kRateHz)});
  if (!scene) return tl::unexpected<Error>(scene.error());
  Stage stage;
  stage.scene = std::move(*scene);
  stage.pipeline.workers = 1;
  auto reference = undisturbed(stage.scene, stage.pipeline);
  if (!reference) return tl::unexpected<Error>(reference.error());
  stage.reference = std::move(*reference);
  return stage;
}

Result<Outcome> play(const Scenario& scenario, const Stage& stage) {
  auto script = script_of(scenario.faults);
  if (!script) return tl::unexpected<Error>(script.error());
  Outcome outcome;
  for (int attempt = 0; attempt < kTries; ++attempt) {
    RunTask task;
    task.scene = &stage.scene;
    task.faults = *script;
    task.camera = camera_options(stage.scene, fresh_address());
    task.pipeline = stage.pipeline;
    task.seconds = scenario.seconds;
    if (scenario.prepare) scenario.prepare(task);
    auto result = run(task);
    if (!result) return tl::unexpected<Error>(result.error());
    outcome.run = std::move(*result);
    if (outcome.run.host_dropped == 0) break;
  }
  outcome.verdict =
      judge(outcome.run, stage.scene, stage.reference, stage.pipeline.deblur.window, scenario.disturbance);
  outcome.expected = expected_losses(*script, outcome.run.injected, scenario.resends);
  return outcome;
}

std::string what_is_wrong(const Scenario& scenario, const Outcome& outcome) {
  const Verdict& v = outcome.verdict;
  std::string all;
  const auto require = [&all](bool holds, const std::string& text) {
    if (!holds) all += (all.empty() ? "" : "; ") + text;
  };
  require(outcome.losses_match(), "lost " + text_of(outcome.run.lost) + ", injected " + text_of(outcome.expected));
  require(v.wrong == 0, std::to_string(v.wrong) + " wrong planes without a flag");
  require(v.strange == 0, std::to_string(v.strange) + " raw planes that the camera did not send");
  require(v.recovered, "the last frame is not right");
  const auto reconnects = static_cast<int>(outcome.run.reconnects);
  require(reconnects >= scenario.least_reconnects && reconnects <= scenario.most_reconnects,
          std::to_string(reconnects) + " reconnects");
  return all;
}

std::string text_of(const Losses& losses) {
  std::string text;
  for (std::size_t c = 0; c < kLossCauses; ++c) {
    if (losses[c] == 0) continue;
    text += (text.empty() ? "" : ", ") + std::string(name(static_cast<LossCause>(c))) + " " + std::to_string(losses[c]);
  }
  return text.empty() ? "none" : text;
}

}  // namespace bolo::tools::faults
