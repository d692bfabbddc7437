// bolo-lab eval detect through its executable.
#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test::verb_test {

struct DetectVerb : ProgramTest {
  DetectVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval", "detect"}) {}
};

TEST_F(DetectVerb, RefusesWrongInputInOneLine) {
  write("hand.csv", "t_s,x_px,y_px\n0,0,0\n9,1,1\n");
  write("one.toml",
        "name = \"one\"\n[network]\nformat = \"onnx\"\ngraph = \"one.onnx\"\n[classes]\nnames = \"person\"\n");
  write("one.onnx", "not a network");
  write("dark.toml",
        "name = \"one\"\n[network]\nformat = \"darknet\"\ngraph = \"one.onnx\"\nweights = \"one.onnx\"\n[classes]\n"
        "names = \"person\"\n");
  write("broken.toml", "name = 1\n");
  const std::string stills = "--scenes x.png --trajectories @hand.csv --detectors ";
  refused_each("", "", "--data /nonexistent", "--data @", stills + "@broken.toml", stills + "/none",
               stills + "@dark.toml");
  // The last of these: the network is none, the still is not there.
  refused_each(stills + "@one.toml", "--size 640", "--size 8x8", "--repeats 0", "--noise -1", "--resamples 1",
               "--threads 0", "--detectors @one.toml", "--unknown", "stray", "");
}

// One labelled still and one without, one look each, one detector.
TEST_F(DetectVerb, JudgesRealStills) {
  const char* const set = std::getenv("BOLO_TEST_DATA");
  const std::filesystem::path data = set != nullptr ? set : "";
  const auto still = data / "street" / "FLIR_05573.png";
  if (!std::filesystem::exists(still)) GTEST_SKIP() << "BOLO_TEST_DATA has no street frames and detectors";
  if (!BOLO_NETWORKS) GTEST_SKIP() << "this build has no networks (libopencv-dnn-dev)";
  const auto json = nlohmann::json::parse(
      printed({"--data", data.string(), "--detectors", std::string(BOLO_DETECTORS) + "/yolo_fastest_xl.toml",
               "--scenes", still.string() + "," + (data / "street" / "FLIR_05108.png").string(), "--trajectories",
               (data / "trajectories" / "slow_indoor.csv").string(), "--repeats", "1", "--resamples", "50", "--size",
               "320x256", "--json"}));
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
  EXPECT_GT(json.at("rows")[0].at("columns").at("sharp").at("ap").get<double>(), 20.0) << "what the network finds";
  const auto& own = json.at("rows")[1];
  if (own.at("objects") > 0) {
    EXPECT_NEAR(own.at("columns").at("sharp").at("ap").get<double>(), 100.0, 1e-9);
  }
}

}  // namespace bolo::tools::test::verb_test
