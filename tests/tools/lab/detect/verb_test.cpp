// bolo-lab eval detect through its executable.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

struct DetectVerb : ProgramTest {
  DetectVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval", "detect"}) {}
};

TEST_F(DetectVerb, RefusesWrongInputInOneLine) {
  const std::string csv = write("hand.csv", "t_s,x_px,y_px\n0,0,0\n9,1,1\n");
  const std::string toml = write("one.toml",
                                 "name = \"one\"\n[network]\nformat = \"onnx\"\ngraph = \"one.onnx\"\n"
                                 "[classes]\nnames = \"person\"\n");
  write("one.onnx", "not a network");
  const std::string broken = write("broken.toml", "name = 1\n");
  const std::vector<std::string> good{"--scenes", "x.png", "--trajectories", csv, "--detectors", toml};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), good.begin(), good.end());
    return more;
  };
  const std::vector<std::vector<std::string>> wrong{
      {},
      {"--data", "/nonexistent"},
      {"--data", folder_.string()},
      {"--scenes", "x.png", "--trajectories", csv, "--detectors", broken},
      {"--scenes", "x.png", "--trajectories", csv, "--detectors", "/none"},
      with({"--size", "640"}),
      with({"--size", "8x8"}),
      with({"--repeats", "0"}),
      with({"--noise", "-1"}),
      with({"--resamples", "1"}),
      with({"--threads", "0"}),
      with({"--least-area", "-1"}),
      with({"--classes", "person"}),
      with({"--plot", "x.png"}),
      with({"--networks", "/nonexistent"}),
      with({"--detectors", toml}),
      with({}),  // the network is none, the still is not there
      with({"--unknown"}),
      with({"stray"})};
  for (const auto& words : wrong) refused(words);
}

TEST_F(DetectVerb, HelpSaysWhatTheJsonHolds) {
  const Outcome outcome = run({"--help"});
  EXPECT_EQ(outcome.exit_code, 0);
  for (const char* word : {"delta_ap_ci95", "recovered", "own_boxes", "--networks", "--model"}) {
    EXPECT_NE(outcome.out.find(word), std::string::npos) << word;
  }
}

// One labelled still and one without, one look each, one detector and a learned model.
TEST_F(DetectVerb, JudgesRealStills) {
  const char* const set = std::getenv("BOLO_TEST_DATA");
  const std::filesystem::path data = set != nullptr ? set : "";
  const auto still = data / "street" / "FLIR_05573.png";
  if (!std::filesystem::exists(still)) GTEST_SKIP() << "BOLO_TEST_DATA has no street frames and detectors";
  if (!BOLO_NETWORKS) GTEST_SKIP() << "this build has no networks (libopencv-dnn-dev)";
  const std::string page = (folder_ / "detect.html").string();
  const Outcome outcome =
      run({"--data", data.string(), "--detectors", std::string(BOLO_DETECTORS) + "/yolo_fastest_xl.toml", "--scenes",
           still.string() + "," + (data / "street" / "FLIR_05108.png").string(), "--trajectories",
           (data / "trajectories" / "slow_indoor.csv").string(), "--repeats", "1", "--resamples", "50", "--size",
           "320x256", "--json", "--plot", page});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto json = nlohmann::json::parse(outcome.out);
  ASSERT_EQ(json.at("rows").size(), 2U);
  EXPECT_EQ(json.at("rows")[0].at("truth"), "labels");
  EXPECT_EQ(json.at("rows")[1].at("truth"), "own_boxes");
  for (const auto& row : json.at("rows")) {
    EXPECT_EQ(row.at("looks"), 1);
    for (const auto& column : json.at("columns")) {
      const auto& figures = row.at("columns").at(column.at("name").get<std::string>());
      if (row.at("objects") == 0) continue;
      EXPECT_GE(figures.at("ap").get<double>(), 0.0);
      EXPECT_LE(figures.at("ap").get<double>(), 100.0);
      EXPECT_NEAR(figures.at("delta_ap").get<double>(),
                  figures.at("ap").get<double>() - row.at("columns").at("blurred").at("ap").get<double>(), 1e-9);
    }
  }
  EXPECT_GT(json.at("rows")[0].at("objects").get<double>(), 5.0);
  const auto& own = json.at("rows")[1];
  if (own.at("objects") > 0) {
    EXPECT_NEAR(own.at("columns").at("sharp").at("ap").get<double>(), 100.0, 1e-9);
  }
  const std::string drawn = contents(page);
  EXPECT_NE(drawn.find("data:image/png"), std::string::npos);
  EXPECT_NE(drawn.find("Bolo +1"), std::string::npos);
}

}  // namespace
}  // namespace bolo::tools::test
