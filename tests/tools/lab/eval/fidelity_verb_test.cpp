// bolo-lab eval fidelity through its executable.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

class FidelityVerb : public ProgramTest {
 protected:
  FidelityVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval", "fidelity"}) {}

  Outcome run_small(std::vector<std::string> words) const {
    const std::vector<std::string> small{"--crop", "64x16", "--frames", "3", "--noises", "0.1", "--speeds", "300"};
    words.insert(words.begin(), small.begin(), small.end());
    return run(words);
  }
};

TEST_F(FidelityVerb, JsonHasEveryColumnOfEveryCell) {
  const Outcome outcome = run_small({"--json", "--lookaheads", "0,1", "--drop", "0.02"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto json = nlohmann::json::parse(outcome.out);
  EXPECT_EQ(json.at("settings").at("crop"), (nlohmann::json{64, 16}));
  ASSERT_EQ(json.at("cells").size(), 2U);
  for (const auto& cell : json.at("cells")) {
    EXPECT_EQ(cell.at("scene"), "street");
    EXPECT_EQ(cell.at("speed_px_s"), 300.0);
    EXPECT_TRUE(cell.at("trajectory").is_null());
    EXPECT_GE(cell.at("qp_grid").size(), 10U);
    for (const auto& column : json.at("columns")) {
      const auto& figures = cell.at("columns").at(column.at("name").get<std::string>());
      if (figures.contains("skipped")) continue;
      EXPECT_GT(figures.at("rmse_k").get<double>(), 0.0);
      EXPECT_GT(figures.at("psnr_db").get<double>(), 10.0);
      EXPECT_LE(figures.at("ssim").get<double>(), 1.0);
      EXPECT_TRUE(figures.contains("edge_width_px"));
      EXPECT_GE(figures.at("edge_rmse_k").get<double>(), figures.at("rmse_k").get<double>());
    }
    EXPECT_NE(cell.at("columns").at("qp_best").at("setting").get<std::string>().find("lambda"), std::string::npos);
  }
  EXPECT_EQ(json.at("drops").size(), 8U);
  for (const auto& verdict : json.at("verdicts")) {
    EXPECT_TRUE(verdict.at("holds").is_boolean() || verdict.at("cells") == 0) << verdict;
    EXPECT_EQ(verdict.at("holds") == false, !verdict.at("misses").empty()) << verdict;
  }
}

TEST_F(FidelityVerb, DoesNotDependOnThreads) {
  const Outcome one = run_small({"--json", "--lookaheads", "1", "--threads", "1"});
  const Outcome two = run_small({"--json", "--lookaheads", "1", "--threads", "2"});
  ASSERT_EQ(one.exit_code, 0) << one.err;
  EXPECT_EQ(one.out, two.out);
  const Outcome other = run_small({"--json", "--lookaheads", "1", "--seed", "2"});
  EXPECT_NE(one.out, other.out);
}

TEST_F(FidelityVerb, TextHasTableAndVerdicts) {
  const Outcome outcome = run_small({"--lookaheads", "1"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  for (const char* word : {"RMSE, K", "SSIM", "Width of the strongest", "rich.-lucy", "Verdicts"}) {
    EXPECT_NE(outcome.out.find(word), std::string::npos) << word;
  }
}

TEST_F(FidelityVerb, FollowsATrajectoryOverAPictureAndDraws) {
  std::string csv = "t_s,x_px,y_px\n";
  for (int i = 0; i <= 100; ++i) {
    const double t = 0.04 * i;
    csv += std::to_string(t) + "," + std::to_string(60 * t) + "," + std::to_string(20 * t * t) + "\n";
  }
  const std::string trajectory = write("hand.csv", csv);
  const std::string page = file("fidelity.html");
  const Outcome outcome = run_small({"--json", "--lookaheads", "0", "--trajectory", trajectory, "--plot", page});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto json = nlohmann::json::parse(outcome.out);
  ASSERT_EQ(json.at("cells").size(), 2U);
  EXPECT_EQ(json.at("cells")[1].at("motion"), "hand");
  EXPECT_TRUE(json.at("cells")[1].at("speed_px_s").is_null());
  ASSERT_EQ(json.at("latency").size(), 1U);
  EXPECT_EQ(json.at("latency")[0].at("lookaheads").size(), 5U);
  const std::string drawn = contents(page);
  EXPECT_NE(drawn.find("Error over latency"), std::string::npos);
  EXPECT_NE(drawn.find("Live estimators"), std::string::npos);
}

TEST_F(FidelityVerb, RealScenesAndTrajectories) {
  const char* data = std::getenv("BOLO_TEST_DATA");
  if (data == nullptr) GTEST_SKIP() << "set BOLO_TEST_DATA to the folder of real scenes and trajectories";
  const auto first = [](const std::filesystem::path& folder, const std::string& extension) -> std::string {
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
      if (entry.path().extension() == extension) return entry.path().string();
    }
    return "";
  };
  const std::string scene = first(std::filesystem::path(data) / "street", ".png");
  const std::string trajectory = first(std::filesystem::path(data) / "trajectories", ".csv");
  if (scene.empty() || trajectory.empty()) GTEST_SKIP() << data << " has no street/*.png or trajectories/*.csv";
  const Outcome outcome = run_small({"--json", "--lookaheads", "1", "--scene", scene, "--trajectory", trajectory});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto table = nlohmann::json::parse(outcome.out);
  for (const auto& cell : table.at("cells")) {
    const auto& columns = cell.at("columns");
    EXPECT_GT(columns.at("blurred").at("rmse_k").get<double>(), 0.1) << cell.at("motion");
  }
}

TEST_F(FidelityVerb, RefusesWrongInputInOneLine) {
  const std::string damaged = write("bad.csv", "t_s,x_px,y_px\n0,0\n");
  const std::vector<std::vector<std::string>> wrong{{"--crop", "320"},
                                                    {"--crop", "8x8"},
                                                    {"--crop", "64x16x2"},
                                                    {"--speeds", "1e9"},
                                                    {"--noises", "-1"},
                                                    {"--noises", "0.1,0.1"},
                                                    {"--lookaheads", "16"},
                                                    {"--frames", "0"},
                                                    {"--threads", "0"},
                                                    {"--drop", "0.9"},
                                                    {"--drop", "0"},
                                                    {"--scene", "/nonexistent.png"},
                                                    {"--trajectory", "/nonexistent.csv"},
                                                    {"--trajectory", damaged},
                                                    {"--plot", "fidelity.png"},
                                                    {"--seed", "x"},
                                                    {"--unknown"},
                                                    {"stray"}};
  for (const auto& words : wrong) refused(words);
}

TEST_F(FidelityVerb, HelpSaysWhatTheJsonHolds) {
  const Outcome outcome = run({"--help"});
  EXPECT_EQ(outcome.exit_code, 0);
  for (const char* word : {"truth_edge_width_px", "gap_blind_rmse_k", "worst_ratio", "--lookaheads"}) {
    EXPECT_NE(outcome.out.find(word), std::string::npos) << word;
  }
}

}  // namespace
}  // namespace bolo::tools::test
