// The evaluations `real`, `pulses`, `pixel` and `loop` of bolo-lab through their executable.
#include <gtest/gtest.h>

#include <cstdlib>

#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

using Json = nlohmann::json;

// On a simulated capture, where it is known which picture is right, and on recordings of real cameras.
struct RealVerb : ProgramTest {
  RealVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval", "real"}) {}
};

// A pan of 2.9 px a frame: what the pixels saw foretells the next frame, and one that was left out, to about the noise;
// what lags or is blurred does not. The picture that foretells better is the one that is nearer to the truth.
TEST_F(RealVerb, RanksPicturesAsTheTruthDoes) {
  constexpr double kNoise = 0.03;
  const std::string pan = file("pan.h5");
  const Outcome made = Program({BOLO_PROGRAM, "simulate", "-o", pan, "--width", "160", "--speed", "586", "--noise",
                                "0.03", "--frames", "44"},
                               file("made"))
                           .outcome();
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const Outcome outcome = run({pan, "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const Json tasks = Json::parse(outcome.out).at("captures").at(0).at("tasks");
  ASSERT_EQ(tasks.size(), 2U);
  for (const Json& task : tasks) {
    SCOPED_TRACE(task.dump(2));
    EXPECT_GT(task.at("judged"), 2);
    EXPECT_NEAR(task.at("speed_px").get<double>(), task.at("name") == "next" ? 2.93 : 5.86, 0.2);
    const auto figure = [&](const char* picture, const char* name) {
      return task.at("pictures").at(picture).at(name).get<double>();
    };
    EXPECT_LT(figure("only_moved", "moved"), 3.0 * kNoise);
    EXPECT_LT(figure("motion", "moved"), 3.0 * kNoise);
    for (const char* name : {"moved", "truth"}) {
      EXPECT_LT(figure("motion", name), 0.5 * figure("mmae", name)) << name;
      EXPECT_LT(figure("mmae", name), figure("inverse", name)) << name;
      EXPECT_LT(figure("inverse", name), figure("blurred", name)) << name;
    }
    EXPECT_LT(figure("mmae", "still"), figure("blurred", "still"));
    EXPECT_LT(5.0 * figure("motion", "moved"), figure("motion", "still"));  // the scene does not rest
  }
}

TEST_F(RealVerb, RecordingsOfRealCameras) {
  const char* data = std::getenv("BOLO_TEST_DATA");
  if (data == nullptr) GTEST_SKIP() << "BOLO_TEST_DATA is not set: no recordings of real cameras";
  const Outcome outcome =
      run({std::string(data) + "/captures/lepton_hand_fast.h5", "--tau", "0.012", "--frames", "40", "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const Json capture = Json::parse(outcome.out).at("captures").at(0);
  EXPECT_EQ(capture.at("unit"), "count");
  const Json& next = capture.at("tasks").at(0);
  EXPECT_GT(next.at("judged"), 10);
  for (const char* picture : {"blurred", "mmae", "motion"}) {
    EXPECT_GT(next.at("pictures").at(picture).at("moved"), next.at("noise")) << picture;
    EXPECT_TRUE(next.at("pictures").at(picture).at("truth").is_null()) << picture;
  }
}

TEST_F(RealVerb, RefusesWrongInputInOneLine) {
  for (const auto& words : {std::vector<std::string>{},
                            {"none.h5"},
                            {"none.h5", "--tau", "0"},
                            {"none.h5", "--frames", "3"},
                            {"none.h5", "--period", "-1"}}) {
    refused(words);
  }
}

// --- `bolo-lab eval pulses` and `eval pixel` through their executable.

struct TrialsVerb : ProgramTest {
  TrialsVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval"}) {}
};

TEST_F(TrialsVerb, PrintsNumbers) {
  const Outcome pulses = run({"pulses", "--seeds", "1", "--json"});
  ASSERT_EQ(pulses.exit_code, 0) << pulses.err;
  const auto trials = nlohmann::json::parse(pulses.out).at("trials");
  EXPECT_EQ(trials.size(), 9U);
  for (const auto& trial : trials) EXPECT_LT(trial.at("worst_error").get<double>(), 0.01);
  const Outcome pixel = run({"pixel", "--draws", "3", "--json"});
  ASSERT_EQ(pixel.exit_code, 0) << pixel.err;
  EXPECT_EQ(nlohmann::json::parse(pixel.out).at("cases").size(), 4U);
  refused({"pulses", "--seeds", "0"});
  refused({"pixel", "--noise", "-1"});
}

// --- bolo-lab eval loop through its executable.

struct LoopVerb : ProgramTest {
  LoopVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval", "loop"}) {}
};

TEST_F(LoopVerb, WhatIsDiagnosedRecoversWhatTheTruthWould) {
  const Outcome outcome = run({"--effects", "fpn_offset,tau_global", "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto json = nlohmann::json::parse(outcome.out);
  ASSERT_EQ(json.at("rows").size(), 2U);
  for (const auto& row : json.at("rows")) {
    EXPECT_GT(row.at("hurts"), 0.05) << row;
    EXPECT_GT(row.at("recovered_share"), 0.8) << row;
    EXPECT_LT(row.at("recovered_share"), 1.2) << row;
    EXPECT_EQ(row.at("found"), nlohmann::json::array({row.at("effect")}));
  }
}

TEST_F(LoopVerb, WrongUsageIsOneLineAndTheExitCodeTwo) {
  for (const auto& words :
       {std::vector<std::string>{"--effects", "gremlins"}, {"--threads", "0"}, {"--frames-scale", "0"}, {"x"}}) {
    refused(words);
  }
}

}  // namespace

}  // namespace bolo::tools::test
