#include <numeric>
#include <sstream>

#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "tools/lab/eval/faults.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::faults {
namespace {

constexpr Geometry kGeometry{64, 24};
constexpr double kRateHz = 200.0;
constexpr double kSeconds = 5.0;  // of scene: longer than any stream
constexpr int kTries = 3;

constexpr std::uint64_t kMostLostOfFour = 1;  // of four frames hit, with working resends on a busy machine

constexpr Disturbance kWhile{.from_s = 0.3, .to_s = 0.5};
constexpr Disturbance kOnce{.from_s = 0.3, .to_s = 0.3};

Result<fakecam::FaultScript> script_of(const std::string& texts) {
  fakecam::FaultScript script;
  std::istringstream words(texts);
  for (std::string text; words >> text;) {
    ASSIGN_OR_RETURN(auto fault, fakecam::parse_fault(text));
    script.push_back(std::move(fault));
  }
  return script;
}

std::string injected_text(const std::vector<fakecam::InjectedFault>& injected) {
  std::vector<std::string> words;
  const auto add = [&words](std::uint64_t n, const char* what) {
    if (n > 0) words.push_back(std::to_string(n) + " " + what);
  };
  for (const fakecam::InjectedFault& fault : injected) {
    add(fault.frames, "frames");
    add(fault.packets, "packets");
    if (fault.frames + fault.packets == 0) add(fault.times, "time");
  }
  return joined(words);
}

// Plays a scenario several times. Reports what was injected, lost and reconnected in the last run, whether losses
// equalled injections in every run, and the first error found.
Result<Json> row_of(const Scenario& scenario, const Stage& stage, int repeats) {
  Json row{{"fault", scenario.name}, {"script", scenario.faults}};
  std::vector<double> recovery_ms;
  std::string wrong;
  bool equal = true;
  for (int i = 0; i < repeats && !interrupted().load(std::memory_order_relaxed); ++i) {
    ASSIGN_OR_RETURN(const auto outcome, at(scenario.name, play(scenario, stage, i + 1)));
    equal = equal && outcome.losses_match();
    recovery_ms.push_back(outcome.verdict.recovery_ms);
    if (wrong.empty()) wrong = unmet_demands(scenario, outcome);
    row.update({{"injected", injected_text(outcome.run.injected)},
                {"lost", text_of(outcome.run.lost)},
                {"equal", equal},
                {"recovery_ms", {{"median", quantile(recovery_ms, 0.5)}, {"worst", quantile(recovery_ms, 1.0)}}},
                {"reconnects", outcome.run.reconnects},
                {"wrong", wrong}});
  }
  return row;
}

Status evaluate_fault(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const int repeats, number_of<int>(given, "repeats", 1, 1000));
  const auto only = given["only"].as<std::string>();
  ASSIGN_OR_RETURN(const auto stage, make_stage());
  Json rows = Json::array();
  std::vector<std::string> wrong;
  Progress progress("faults", scenarios().size());
  for (const Scenario& scenario : scenarios()) {
    if (!only.empty() && scenario.name != only) continue;
    auto row = row_of(scenario, stage, repeats);
    if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
    RETURN_IF_ERROR(row);
    if (!(*row)["wrong"].get_ref<const std::string&>().empty()) wrong.push_back(scenario.name);
    rows.push_back(std::move(*row));
    progress.update(rows.size());
  }
  if (rows.empty()) return bad_input("there is no fault '" + only + "' here; without --only all are tried");
  print_report({{"repeats", repeats}, {"rows", rows}}, given.count("json") != 0);
  return wrong.empty() ? Status{} : failed("what must hold does not: " + joined(wrong));
}

}  // namespace

const std::vector<Scenario>& scenarios() {
  static const std::vector<Scenario> kScenarios = [] {
    const Demands ask{.prepare = [](RunTask& task) { task.camera.resend = true; }};
    // With time for the answers even if the camera's thread has to wait for a processor.
    const Demands ask_patiently{.resends = true, .exact = false, .prepare = [](RunTask& task) {
                                  task.camera.resend = true;
                                  task.camera.packet_timeout_us = 10'000;
                                  task.camera.frame_retention_us = 200'000;
                                }};
    const Demands metadata{.prepare = [](RunTask& task) { task.rows_below = task.camera.metadata_rows = 3; }};
    const Demands big_endian{
        .prepare = [](RunTask& task) { task.camera.pixel_order = genicam::PixelOrder::kBigEndian; }};
    const Demands drop_repeated{.prepare = [](RunTask& task) { task.pipeline.undo.drop_repeated = true; }};
    const Demands reconnect{.least_reconnects = 1, .most_reconnects = 1};
    const Demands reconnect_lossy{.least_reconnects = 1, .most_reconnects = 1, .exact = false};
    const Demands reconnect_twice{.least_reconnects = 1, .most_reconnects = 2};

    return std::vector<Scenario>{
        // The network.
        {"loss", "loss:at=0.3,for=0.2,rate=0.05", 0.75, kWhile},
        {"loss, resent", "loss:at=0.3,for=0.2,rate=0.05", 0.75, kWhile, ask_patiently},
        {"loss, unanswered", "loss:at=0.3,for=0.2,rate=0.05 resend_unanswered", 0.75, kWhile, ask},
        {"reorder", "reorder:at=0.3,for=0.2,rate=0.3,by=3", 0.75, kWhile},
        {"duplicate", "duplicate:at=0.3,for=0.2,rate=0.3", 0.75, kWhile},
        {"garbage", "garbage:at=0.3,for=0.2,rate=0.05", 0.75, kWhile},
        // The frames.
        {"id gap", "id_gap:at=0.3,ids=7", 0.6, kOnce},
        {"time jump", "time_jump:at=0.3,by=0.5", 0.6, {.from_s = 0.3, .to_s = 0.3, .clock_shift_s = 0.5}},
        {"time jump back", "time_jump:at=0.3,by=-0.5", 0.6, {.from_s = 0.3, .to_s = 0.3, .clock_shift_s = -0.5}},
        {"short stall", "stall:at=0.3,frames=5", 0.6, {.from_s = 0.3, .to_s = 0.325}},
        {"stall", "stall:at=0.3,for=0.2", 0.8, kWhile},
        {"nuc", "nuc:at=0.3,for=0.2,offset=0.5", 0.8, {0.3, 0.5, 0.0, 50}, drop_repeated},
        {"byte order", "byte_order", 0.4, {}, big_endian},
        {"metadata rows", "metadata_rows:rows=3", 0.4, {}, metadata},
        // The camera.
        {"freeze", "freeze:at=0.3,for=0.2", 0.8, kWhile},
        {"long stall", "stall:at=0.3,for=0.8", 1.8, {.from_s = 0.3, .to_s = 1.1}, reconnect_lossy},
        {"control loss", "control_loss:at=0.3", 2.0, kOnce, reconnect},
        {"reboot", "reboot:at=0.3,for=0.5", 2.0, {.from_s = 0.3, .to_s = 0.8}, reconnect_twice},
        {"windowing drop", "windowing_drop:for=0.5", 0.4},
    };
  }();
  return kScenarios;
}

Result<Stage> make_stage() {
  sim::CameraSettings camera;
  camera.geometry = kGeometry;
  camera.rate_hz = kRateHz;
  camera.threads = 1;
  ASSIGN_OR_RETURN(auto scene, record_street(camera, {.frames = static_cast<std::size_t>(kSeconds * kRateHz)}));
  Stage stage;
  stage.scene = std::move(scene);
  stage.pipeline.workers = 1;
  ASSIGN_OR_RETURN(stage.reference, undisturbed(stage.scene, stage.pipeline));
  return stage;
}

Result<Outcome> play(const Scenario& scenario, const Stage& stage, int seed) {
  ASSIGN_OR_RETURN(auto script, script_of(scenario.faults));
  for (fakecam::Fault& fault : script) {
    if (fault.has("seed")) fault.values["seed"] = seed;
  }
  Outcome outcome;
  for (int attempt = 0; attempt < kTries; ++attempt) {
    RunTask task;
    task.scene = &stage.scene;
    task.faults = script;
    task.camera = camera_options(stage.scene, fresh_address());
    task.pipeline = stage.pipeline;
    task.seconds = scenario.seconds;
    if (scenario.demands.prepare) scenario.demands.prepare(task);
    ASSIGN_OR_RETURN(outcome.run, run(task));
    if (outcome.run.host_dropped == 0) break;
  }
  outcome.verdict =
      judge(outcome.run, stage.scene, stage.reference, stage.pipeline.deblur.window, scenario.disturbance);
  outcome.expected = expected_losses(script, outcome.run.injected, scenario.demands.resends);
  return outcome;
}

std::string unmet_demands(const Scenario& scenario, const Outcome& outcome) {
  const Verdict& v = outcome.verdict;
  std::vector<std::string> all;
  const auto require = [&all](bool holds, const std::string& text) {
    if (!holds) all.push_back(text);
  };
  const std::uint64_t lost = std::accumulate(outcome.run.lost.begin(), outcome.run.lost.end(), std::uint64_t{0});
  require(lost >= v.never_came,
          std::to_string(v.never_came) + " frames never came, " + std::to_string(lost) + " are counted");
  require(!scenario.demands.resends || 4 * lost <= kMostLostOfFour * outcome.run.injected.front().frames,
          std::to_string(lost) + " frames lost in spite of resends");
  require(outcome.losses_match() || !scenario.demands.exact,
          "lost " + text_of(outcome.run.lost) + ", injected " + text_of(outcome.expected));
  require(v.wrong == 0, std::to_string(v.wrong) + " wrong planes without a flag");
  require(v.strange == 0, std::to_string(v.strange) + " raw planes that the camera did not send");
  require(v.recovered, "the last frame is not right");
  const auto reconnects = static_cast<int>(outcome.run.reconnects);
  require(reconnects >= scenario.demands.least_reconnects && reconnects <= scenario.demands.most_reconnects,
          std::to_string(reconnects) + " reconnects");
  return joined(all, "; ");
}

std::string text_of(const Losses& losses) {
  std::vector<std::string> words;
  for (std::size_t c = 0; c < kLossCauses; ++c) {
    if (losses[c] == 0) continue;
    words.push_back(std::string(name(static_cast<LossCause>(c))) + " " + std::to_string(losses[c]));
  }
  return words.empty() ? "none" : joined(words);
}

namespace {

constexpr double kTrialRateHz = 200.0;
constexpr double kSpeedPxS = 200.0;
constexpr double kCleanEndS = 0.1;  // without loss, so that every frame hit is also judged
constexpr double kSpareS = 1.0;     // of scene beyond the run's time, for the time to stop

void add(SquareSum& sum, const Counts& shown, const std::vector<float>& truth, const LinearScale& scale) {
  for (std::size_t p = 0; p < truth.size(); ++p) {
    sum.add(scale.to_physical(shown[p]), static_cast<double>(truth[p]));
  }
}

std::size_t frame_number(const Published& frame, double period_s) {
  const double since_first_s = static_cast<double>(frame.meta.camera_ns - kFirstCameraNs) / kNsPerSecond;
  return static_cast<std::size_t>(std::lround(since_first_s / period_s));
}

struct LossTask {
  double rate = 0.0;  // share of packets
  bool resend = false;
  int packet_size = 0;  // bytes
  double seconds = 0.0;
};

Result<fakecam::FaultScript> script_of(const LossTask& task) {
  ASSIGN_OR_RETURN(auto fault, fakecam::parse_fault("loss"));
  fault.values["rate"] = task.rate;
  fault.values["for"] = task.seconds - kCleanEndS;
  return fakecam::FaultScript{std::move(fault)};
}

// A street, 640x120 at 200 Hz.
Result<Recording> loss_scene(double seconds) {
  sim::CameraSettings camera;
  camera.rate_hz = kTrialRateHz;
  return record_street(
      camera, {.speed_px_s = kSpeedPxS, .frames = static_cast<std::size_t>((seconds + kSpareS) * camera.rate_hz)});
}

// Frames sent, those of them hit by loss (frames_hit), those counted as lost on the way (network: incomplete, missing)
// and because deblurring was behind (no slot, queue full); errors against the truth of frames with a full window.
Result<Json> try_loss(const LossTask& task, const Recording& scene) {
  RunTask run_task;
  run_task.scene = &scene;
  ASSIGN_OR_RETURN(run_task.faults, script_of(task));
  run_task.camera = camera_options(scene, fresh_address());
  run_task.camera.packet_size = task.packet_size;
  run_task.camera.resend = task.resend;
  run_task.pipeline.workers = 2;
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
              {"frames_per_s", static_cast<double>(result.frames.size()) / task.seconds},
              {"latency_ms", {{"p50", quantile(result.latency_ms, 0.5)}, {"p99", quantile(result.latency_ms, 0.99)}}},
              {"rmse_raw_k", raw.root_mean()},
              {"rmse_deblurred_k", deblurred.root_mean()},
              {"host_dropped_packets", result.host_dropped}};
}

Status evaluate_loss(const cxxopts::ParseResult& given) {
  const auto rates = given["rates"].as<std::vector<double>>();
  for (const double rate : rates) RETURN_IF_ERROR(within(rate, "rates", 0.0, 1.0));
  ASSIGN_OR_RETURN(const int packet_size, number_of<int>(given, "packet-size", 576, 9000));
  ASSIGN_OR_RETURN(const double seconds, number_of<double>(given, "seconds", 0.5, 60.0));
  ASSIGN_OR_RETURN(const auto scene, loss_scene(seconds));
  Json rows = Json::array();
  Progress progress("runs", 2 * rates.size());
  for (const double rate : rates) {
    for (const bool resend : {false, true}) {
      if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
      ASSIGN_OR_RETURN(auto row, try_loss({rate, resend, packet_size, seconds}, scene));
      rows.push_back(std::move(row));
      progress.update(rows.size());
    }
  }
  print_report({{"rows", rows}}, given.count("json") != 0);
  return {};
}

}  // namespace

}  // namespace bolo::tools::faults

int bolo::tools::eval_faults_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo-lab eval faults",
      "Runs the daemon's pipeline against a fake camera that fails, one fault after the other,\n"
      "through real packets, and compares what it counts with what was injected and what it\n"
      "publishes with an undisturbed run. recovery_ms: from the fault's end until every published plane\n"
      "is that of an undisturbed run again; a window of 17 frames is 85 ms, and a silent camera is\n"
      "opened again after 0.6 s. Frames that it does not send meanwhile are nobody's: not 'equal'.\n");
  add_option<int>(cli, "repeats", "Runs of each fault", "3", "N");
  add_option<std::string>(cli, "only", "This fault only, by its name in the table", "", "NAME");
  add_option<bool>(cli, "json", "Print the table as JSON");
  return run_verb("faults", std::move(cli), argc, argv, faults::evaluate_fault);
}

int bolo::tools::eval_loss_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo-lab eval loss",
      "Streams a street of 640x120 pixels at 200 Hz from a fake camera that loses packets, once\n"
      "without and once with asking for them again, and judges what is published. frames_hit: those that\n"
      "lost a packet at first. frames_lost: by the network (incomplete, missing), or since deblurring\n"
      "was behind. latency_ms: first packet received to published. Errors are over the frames that came.\n");
  add_option<std::vector<double>>(cli, "rates", "Shares of the packets that are lost, separated by commas",
                                  "0,0.001,0.01,0.05", "A,B");
  add_option<int>(cli, "packet-size", "Bytes: 1500 on every link, up to 9000 with jumbo frames", "1500", "BYTES");
  add_option<double>(cli, "seconds", "Of each run", "4", "S");
  add_option<bool>(cli, "json", "Print the table as JSON");
  return run_verb("loss", std::move(cli), argc, argv, faults::evaluate_loss);
}
