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
  // In the last of these the network is missing, and so is the still.
  refused_each(stills + "@one.toml", "--size 640", "--size 8x8", "--repeats 0", "--noise -1", "--resamples 1",
               "--threads 0", "--detectors @one.toml", "--unknown", "stray", "");
}

// One labelled and one unlabelled still, one view each. Detections in the sharp picture show that the network got the
// picture as it was trained for, and that its outputs were decoded correctly.
TEST_F(DetectVerb, JudgesRealStills) {
  const char* const set = std::getenv("BOLO_TEST_DATA");
  const std::filesystem::path data = set != nullptr ? set : "";
  const auto still = data / "street" / "FLIR_05573.png";
  if (!std::filesystem::exists(still)) GTEST_SKIP() << "BOLO_TEST_DATA has no street frames and detectors";
  if (!BOLO_NETWORKS) GTEST_SKIP() << "this build has no networks (libopencv-dnn-dev)";
  const std::string detectors = std::string(BOLO_DETECTORS) + "/";
  const auto json = nlohmann::json::parse(printed(
      {"--data", data.string(), "--detectors",
       detectors + "nanodet_m.toml," + detectors + "yolo_fastest_body.toml," + detectors + "yolo_fastest_xl.toml",
       "--scenes", still.string() + "," + (data / "street" / "FLIR_05108.png").string(), "--trajectories",
       (data / "trajectories" / "slow_indoor.csv").string(), "--repeats", "1", "--resamples", "50", "--size", "320x256",
       "--json"}));
  const std::map<std::string, double> least{{"NanoDet-m", 30.0}, {"Yolo-Fastest body", 8.0}, {"Yolo-Fastest XL", 25.0}};
  ASSERT_EQ(json.at("rows").size(), 8U) << "of labels and of own boxes: each detector, and their mean";
  for (std::size_t i = 0; i < 8; ++i) {
    const auto& row = json.at("rows")[i];
    SCOPED_TRACE(row.dump());
    EXPECT_EQ(row.at("truth"), i < 4 ? "labels" : "own_boxes");
    EXPECT_EQ(row.at("looks"), 1);
    EXPECT_EQ(row.at("detector").is_null(), i % 4 == 3);
    if (row.at("objects") == 0) continue;
    const auto ap = [&](const std::string& column) { return row.at("columns").at(column).at("ap").get<double>(); };
    for (const auto& column : json.at("columns")) {
      const std::string name = column.at("name");
      EXPECT_NEAR(row.at("columns").at(name).at("delta_ap").get<double>(), ap(name) - ap("blurred"), 1e-9);
    }
    if (i < 3) {
      EXPECT_GT(ap("sharp"), least.at(row.at("detector")));
    }
    if (i >= 4 && i < 7) {
      EXPECT_NEAR(ap("sharp"), 100.0, 1e-9);
    }
  }
}

}  // namespace bolo::tools::test::verb_test
