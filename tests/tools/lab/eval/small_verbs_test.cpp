// The evaluations `real`, `pulses`, `pixel` and `loop` of bolo-lab through their executable.
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
  const auto pan = words(BOLO_PROGRAM " simulate -o @pan.h5 --width 160 --speed 586 --noise 0.03 --frames 44");
  ASSERT_EQ(Program(pan, file("made")).wait(), 0);
  const Json tasks = Json::parse(printed(words("@pan.h5 --json"))).at("captures").at(0).at("tasks");
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
  const std::string out =
      printed(words(std::string(data) + "/captures/lepton_hand_fast.h5 --tau 0.012 --frames 40 --json"));
  const Json capture = Json::parse(out).at("captures").at(0);
  EXPECT_EQ(capture.at("unit"), "count");
  const Json& next = capture.at("tasks").at(0);
  EXPECT_GT(next.at("judged"), 10);
  for (const char* picture : {"blurred", "mmae", "motion"}) {
    EXPECT_GT(next.at("pictures").at(picture).at("moved"), next.at("noise")) << picture;
    EXPECT_TRUE(next.at("pictures").at(picture).at("truth").is_null()) << picture;
  }
}

TEST_F(RealVerb, RefusesWrongInputInOneLine) {
  refused_each("", "", "none.h5", "none.h5 --tau 0", "none.h5 --frames 3", "none.h5 --period -1");
}

// --- `bolo-lab eval pulses`, `eval pixel` and `eval loop`
struct TrialsVerb : ProgramTest {
  TrialsVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval"}) {}
};

TEST_F(TrialsVerb, PrintsNumbers) {
  const Json trials = Json::parse(printed(words("pulses --seeds 1 --json"))).at("trials");
  EXPECT_EQ(trials.size(), 9U);
  for (const Json& trial : trials) EXPECT_LT(trial.at("worst_error").get<double>(), 0.01);
  EXPECT_EQ(Json::parse(printed(words("pixel --draws 3 --json"))).at("cases").size(), 4U);
  refused_each("", "pulses --seeds 0", "pixel --noise -1");
}

TEST_F(TrialsVerb, WhatTheLoopDiagnosesRecoversWhatTheTruthWould) {
  const Json rows = Json::parse(printed(words("loop --effects fpn_offset,tau_global --json"))).at("rows");
  ASSERT_EQ(rows.size(), 2U);
  for (const Json& row : rows) {
    EXPECT_GT(row.at("hurts"), 0.05) << row;
    EXPECT_GT(row.at("recovered_share"), 0.8) << row;
    EXPECT_LT(row.at("recovered_share"), 1.2) << row;
    EXPECT_EQ(row.at("found"), Json::array({row.at("effect")}));
  }
  refused_each("", "loop --effects gremlins", "loop --threads 0", "loop --frames-scale 0", "loop x");
}

}  // namespace

}  // namespace bolo::tools::test
