#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test::fidelity_verb_test {

class FidelityVerb : public ProgramTest {
 protected:
  FidelityVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval", "fidelity"}) {}

  std::string printed_small(const std::string& line) const {
    return printed(words("--crop 64x16 --frames 3 --noises 0.1 --speeds 300 " + line));
  }
};

TEST_F(FidelityVerb, JsonHasEveryColumnOfEveryCell) {
  const auto json = nlohmann::json::parse(printed_small("--json --lookaheads 0,2"));
  EXPECT_EQ(json.at("settings").at("crop"), (nlohmann::json{64, 16}));
  ASSERT_EQ(json.at("cells").size(), 2U);
  for (const auto& cell : json.at("cells")) {
    EXPECT_EQ(cell.at("scene"), "street");
    EXPECT_EQ(cell.at("motion"), "300 px/s");
    for (const auto& column : json.at("columns")) {
      const auto& figures = cell.at("columns").at(column.at("name").get<std::string>());
      EXPECT_EQ(figures.contains("skipped"), column.at("name") == "motion" && cell.at("lookahead") == 2) << figures;
      if (figures.contains("skipped")) continue;
      EXPECT_GT(figures.at("rmse_k").get<double>(), 0.0);
      EXPECT_TRUE(figures.contains("edge_width_px"));
      EXPECT_GT(figures.at("shifted_rmse_k").get<double>(), 0.0);
      EXPECT_GT(figures.at("flat_noise_k").get<double>(), 0.0);
    }
    EXPECT_NE(cell.at("columns").at("qp_best").at("setting").get<std::string>().find("lambda"), std::string::npos);
  }
}

TEST_F(FidelityVerb, DoesNotDependOnThreads) {
  const std::string one = printed_small("--json --lookaheads 1 --threads 1");
  EXPECT_EQ(one, printed_small("--json --lookaheads 1 --threads 2"));
  EXPECT_NE(one, printed_small("--json --lookaheads 1 --seed 2"));
}

TEST_F(FidelityVerb, FollowsATrajectoryOverAPictureAndDraws) {
  std::string csv = "t_s,x_px,y_px\n";
  for (int i = 0; i <= 100; ++i) {
    const double t = 0.04 * i;
    csv += std::to_string(t) + "," + std::to_string(60 * t) + "," + std::to_string(20 * t * t) + "\n";
  }
  write("hand.csv", csv);
  const auto json =
      nlohmann::json::parse(printed_small("--json --lookaheads 0 --trajectory @hand.csv --plot @fidelity.html"));
  ASSERT_EQ(json.at("cells").size(), 2U);
  EXPECT_EQ(json.at("cells")[1].at("motion"), "hand");
  expect_parts(contents(file("fidelity.html")), {"Error over latency", "300 px/s", "hand"});
}

TEST_F(FidelityVerb, RefusesWrongInputInOneLine) {
  write("bad.csv", "t_s,x_px,y_px\n0,0\n");
  refused_each("", "--crop 320", "--crop 8x8", "--crop 64x16x2", "--speeds 1e9", "--noises -1", "--noises 0.1,0.1",
               "--lookaheads 16", "--frames 0", "--threads 0", "--scene /nonexistent.png",
               "--trajectory /nonexistent.csv", "--trajectory @bad.csv", "--plot fidelity.png", "--seed x", "--unknown",
               "stray");
}

}  // namespace bolo::tools::test::fidelity_verb_test
