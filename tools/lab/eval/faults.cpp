#include "tools/lab/eval/faults.hpp"

#include <numeric>
#include <sstream>

#include "src/core/statistics.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::faults {
namespace {

constexpr Geometry kGeometry{64, 24};
constexpr double kRateHz = 200.0;
constexpr double kSeconds = 5.0;  // of the scene: longer than any stream
constexpr int kTries = 3;

constexpr std::uint64_t kMostLostOfFour = 1;  // of the frames that are hit, with working resends on a busy machine

void ask_for_resends(RunTask& task) { task.camera.resend = true; }

// With time for the answers, also where the camera's thread has to wait for a processor.
void ask_patiently(RunTask& task) {
  task.camera.resend = true;
  task.camera.packet_timeout_us = 10'000;
  task.camera.frame_retention_us = 200'000;
}

void add_metadata_rows(RunTask& task) {
  task.rows_below = 3;
  task.camera.metadata_rows = 3;
}

// What strikes from 0.3 to 0.5 s.
constexpr Disturbance kWhile{.from_s = 0.3, .to_s = 0.5};
// What strikes at 0.3 s and is over at once.
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

// One scenario, a few times: what was injected, lost and reconnected in the last run, whether what was lost is what was
// injected, in every run, and the first thing that was found wrong.
Result<Json> row_of(const Scenario& scenario, const Stage& stage, int repeats) {
  Json row{{"fault", scenario.name}, {"script", scenario.faults}};
  std::vector<double> recovery_ms;
  std::string wrong;
  bool equal = true;
  for (int i = 0; i < repeats && !interrupted().load(std::memory_order_relaxed); ++i) {
    const auto outcome = play(scenario, stage, i + 1);
    if (!outcome) return at(scenario.name, outcome.error());
    equal = equal && outcome->losses_match();
    recovery_ms.push_back(outcome->verdict.recovery_ms);
    if (wrong.empty()) wrong = what_is_wrong(scenario, *outcome);
    row.update({{"injected", injected_text(outcome->run.injected)},
                {"lost", text_of(outcome->run.lost)},
                {"equal", equal},
                {"recovery_ms", {{"median", quantile(recovery_ms, 0.5)}, {"worst", quantile(recovery_ms, 1.0)}}},
                {"reconnects", outcome->run.reconnects},
                {"wrong", wrong}});
  }
  return row;
}

const std::vector<TextColumn> kColumns{{"fault", -17, "fault"},
                                       {"injected", -26, "injected"},
                                       {"counted as lost", -26, "lost"},
                                       {"equal", -6, "equal"},
                                       {"median", 8, "recovery_ms/median", "%.0f"},
                                       {"worst ms", 8, "recovery_ms/worst", "%.0f"},
                                       {"reconnects", 11, "reconnects"},
                                       {" wrong", 0, "wrong"}};

Status evaluate(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const int repeats, number_of<int>(given, "repeats", 1, 1000));
  const auto only = given["only"].as<std::string>();
  ASSIGN_OR_RETURN(const auto stage, make_stage());
  Rows rows(given.count("json") != 0, kColumns);
  std::vector<std::string> wrong;
  Progress progress("faults", scenarios().size());
  for (const Scenario& scenario : scenarios()) {
    if (!only.empty() && scenario.name != only) continue;
    auto row = row_of(scenario, stage, repeats);
    if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
    RETURN_IF_ERROR(row);
    if ((*row)["wrong"] != "") wrong.push_back(scenario.name);
    rows.add(std::move(*row));
    progress.update(rows.count());
  }
  if (rows.count() == 0) return bad_input("there is no fault '" + only + "' here; without --only all are tried");
  rows.finish(
      {{"repeats", repeats}}, "rows",
      "64x24 pixels at 200 Hz; a silent camera is opened again after 0.6 s. Recovery: from the fault's end until\n"
      "every published plane is that of an undisturbed run again; a window of 17 frames is 85 ms. Where 'equal'\n"
      "may be no: frames that a camera does not send while it is opened again, which are nobody's.");
  return wrong.empty() ? Status{} : failed("what must hold does not: " + joined(wrong));
}

}  // namespace

const std::vector<Scenario>& scenarios() {
  static const std::vector<Scenario> kScenarios{
      // The network.
      {"loss", "loss:at=0.3,for=0.2,rate=0.05", 0.75, kWhile},
      {"loss, resent",
       "loss:at=0.3,for=0.2,rate=0.05",
       0.75,
       kWhile,
       {.resends = true, .exact = false, .prepare = ask_patiently}},
      {"loss, unanswered",
       "loss:at=0.3,for=0.2,rate=0.05 resend_unanswered",
       0.75,
       kWhile,
       {.prepare = ask_for_resends}},
      {"reorder", "reorder:at=0.3,for=0.2,rate=0.3,by=3", 0.75, kWhile},
      {"duplicate", "duplicate:at=0.3,for=0.2,rate=0.3", 0.75, kWhile},
      {"garbage", "garbage:at=0.3,for=0.2,rate=0.05", 0.75, kWhile},
      // The frames.
      {"id gap", "id_gap:at=0.3,ids=7", 0.6, kOnce},
      {"time jump", "time_jump:at=0.3,by=0.5", 0.6, {.from_s = 0.3, .to_s = 0.3, .clock_shift_s = 0.5}},
      {"time jump back", "time_jump:at=0.3,by=-0.5", 0.6, {.from_s = 0.3, .to_s = 0.3, .clock_shift_s = -0.5}},
      {"short stall", "stall:at=0.3,frames=5", 0.6, {.from_s = 0.3, .to_s = 0.325}},
      {"stall", "stall:at=0.3,for=0.2", 0.8, kWhile},
      {"nuc",
       "nuc:at=0.3,for=0.2,offset=0.5",
       0.8,
       {.from_s = 0.3, .to_s = 0.5, .offset_counts = 50},
       {.prepare = [](RunTask& task) { task.pipeline.undo.drop_repeated = true; }}},
      {"byte order",
       "byte_order",
       0.4,
       {},
       {.prepare = [](RunTask& task) { task.camera.pixel_order = genicam::PixelOrder::kBigEndian; }}},
      {"metadata rows", "metadata_rows:rows=3", 0.4, {}, {.prepare = add_metadata_rows}},
      // The camera.
      {"freeze", "freeze:at=0.3,for=0.2", 0.8, kWhile},
      {"long stall",
       "stall:at=0.3,for=0.8",
       1.8,
       {.from_s = 0.3, .to_s = 1.1},
       {.least_reconnects = 1, .most_reconnects = 1, .exact = false}},
      {"control loss", "control_loss:at=0.3", 2.0, kOnce, {.least_reconnects = 1, .most_reconnects = 1}},
      {"reboot",
       "reboot:at=0.3,for=0.5",
       2.0,
       {.from_s = 0.3, .to_s = 0.8},
       {.least_reconnects = 1, .most_reconnects = 2}},
      {"windowing drop", "windowing_drop:for=0.5", 0.4},
  };
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

std::string what_is_wrong(const Scenario& scenario, const Outcome& outcome) {
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

int eval_faults_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval faults",
                       "Runs the daemon's pipeline against a fake camera that fails, one fault after the other,\n"
                       "through real packets, and compares what it counts with what was injected and what it\n"
                       "publishes with an undisturbed run.\n");
  add_option<int>(cli, "repeats", "Runs of each fault", "3", "N");
  add_option<std::string>(cli, "only", "This fault only, by its name in the table", "", "NAME");
  add_option<bool>(cli, "json", "Print the table as JSON");
  return run_verb("eval faults", std::move(cli), argc, argv, evaluate);
}

}  // namespace bolo::tools::faults
