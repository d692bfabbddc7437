// `bolo calibrate` as its users meet it.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "src/capture/pixel_maps_io.hpp"
#include "src/model/camera_profile.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

namespace fs = std::filesystem;

class Calibrate : public testing::Test {
 protected:
  Outcome bolo(std::vector<std::string> words) const {
    words.insert(words.begin(), BOLO_PROGRAM);
    return Program(folder_, std::move(words)).outcome();
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  void simulate(const std::string& name, std::vector<std::string> more) const {
    std::vector<std::string> words{"simulate", "-o", path(name),   "--width",       "32",
                                   "--height", "24", "--no-truth", "--camera-seed", "5"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome done = bolo(words);
    ASSERT_EQ(done.exit_code, 0) << done.err;
  }

  const Scratch scratch_;
  const fs::path folder_ = scratch_.path();
};

TEST_F(Calibrate, WritesProfileMapsAndPicture) {
  simulate("chopper.h5", {"--stimulus", "chopper", "--effect", "tau_spread:rms=0.05", "--tau", "0.0105"});
  simulate("shutter.h5", {"--stimulus", "uniform", "--effect", "fpn_offset", "--frames", "100"});
  const Outcome done = bolo({"calibrate", path("chopper.h5"), path("shutter.h5"), "-o", path("mine.toml"), "--plot",
                             path("fit.svg"), "--json"});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  const auto json = nlohmann::json::parse(done.out);
  const double tau_s = json.at("tau_s");
  EXPECT_NEAR(tau_s, 0.0105, 1e-4);
  ASSERT_EQ(json.at("tau_ci95").size(), 2U);
  EXPECT_LT(json.at("tau_ci95")[0].get<double>(), 0.0105);
  EXPECT_GT(json.at("tau_ci95")[1].get<double>(), 0.0105);
  EXPECT_NEAR(json.at("noise_k").get<double>(), 0.030, 0.003);
  EXPECT_NEAR(json.at("rmse_k").get<double>(), 0.030, 0.003);
  EXPECT_NEAR(json.at("gap").get<double>(), 1.0, 0.05);
  EXPECT_EQ(json.at("edges").get<int>(), 22);
  EXPECT_NEAR(json.at("tau_spread").get<double>(), 0.05, 0.005);

  const auto profile = model::read_profile(path("mine.toml"));
  ASSERT_TRUE(profile) << profile.error().message;
  const double low = json.at("tau_ci95")[0];
  const double high = json.at("tau_ci95")[1];
  EXPECT_NEAR(profile->tau_s, tau_s, 0.05 * (high - low));
  std::stringstream text;
  text << std::ifstream(path("mine.toml")).rdbuf();
  EXPECT_NE(text.str().find("# 0.0001 to 1 s; measured, 95 % interval 0.01"), std::string::npos) << text.str();
  EXPECT_NE(text.str().find("# 0 to 100 K; measured\n"), std::string::npos) << text.str();
  EXPECT_NE(text.str().find("; default \"FLIR A655sc\"\nmodel = \"Bolo"), std::string::npos) << text.str();
  EXPECT_FALSE(std::regex_search(text.str(), std::regex("\\.[0-9]{11}")))
      << "more digits than are known: " << text.str();
  EXPECT_EQ(profile->maps.filename(), "mine-maps.h5");
  const auto maps = capture::read_profile_maps(*profile);
  ASSERT_TRUE(maps) << maps.error().message;
  EXPECT_EQ(maps->tau_s.size(), 32U * 24U);
  EXPECT_EQ(maps->offset.size(), 32U * 24U);
  EXPECT_GT(fs::file_size(path("fit.svg")), 10000U);

  // What was written is what the deblurring takes.
  const Outcome sharp = bolo({"deblur", path("chopper.h5"), "-o", path("sharp.h5"), "--profile", path("mine.toml")});
  EXPECT_EQ(sharp.exit_code, 0) << sharp.err;
}

TEST_F(Calibrate, StartsFromAProfileAndPutsMapsWhereAsked) {
  simulate("chopper.h5", {"--stimulus", "chopper", "--effect", "tau_spread"});
  std::ofstream(path("old.toml")) << "row_delay_s = 2.5e-5\n";
  const Outcome done = bolo({"calibrate", path("chopper.h5"), "-o", path("mine.toml"), "--profile", path("old.toml"),
                             "--maps", path("pixels.h5")});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  EXPECT_NE(done.out.find("tau  "), std::string::npos);
  const auto profile = model::read_profile(path("mine.toml"));
  ASSERT_TRUE(profile) << profile.error().message;
  EXPECT_EQ(profile->row_delay_s, 2.5e-5);
  EXPECT_TRUE(fs::exists(path("pixels.h5")));
  EXPECT_EQ(fs::weakly_canonical(profile->maps), fs::weakly_canonical(path("pixels.h5")));
}

TEST_F(Calibrate, SaysWhatIsWrongInOneLine) {
  simulate("shutter.h5", {"--stimulus", "uniform", "--frames", "60"});
  simulate("pan.h5", {"--frames", "120"});
  simulate("bigger.h5", {"--width", "40", "--stimulus", "uniform", "--frames", "20"});
  simulate("chopper.h5", {"--stimulus", "chopper", "--frames", "120"});
  struct Case {
    std::vector<std::string> words;
    std::string says;
  };
  const std::string out = path("never.toml");
  const std::vector<Case> cases{
      {{"calibrate"}, "give -o"},
      {{"calibrate", "-o", out}, "which captures"},
      {{"calibrate", path("none.h5"), "-o", out}, "none.h5"},
      {{"calibrate", path("shutter.h5"), "-o", out}, "no capture with pulses"},
      {{"calibrate", path("pan.h5"), "-o", out}, "no rectangular pulses"},
      {{"calibrate", path("chopper.h5"), path("bigger.h5"), "-o", out}, "another size"},
      {{"calibrate", path("chopper.h5"), path("pan.h5"), "-o", out}, "no still field"},
      {{"calibrate", path("chopper.h5"), "-o", out, "--profile", path("none.toml")}, "none.toml"},
      {{"calibrate", path("chopper.h5"), "-o", path("nowhere/mine.toml")}, "nowhere/mine.toml"},
      {{"calibrate", path("chopper.h5"), "-o", out, "--threads", "2"}, "threads"}};
  for (const Case& one : cases) {
    const Outcome done = bolo(one.words);
    EXPECT_EQ(done.exit_code, 2) << one.says << ": " << done.err;
    EXPECT_NE(done.err.find(one.says), std::string::npos) << done.err;
    EXPECT_EQ(std::ranges::count(done.err, '\n'), 1) << done.err;
    EXPECT_EQ(done.out, "");
  }
  EXPECT_FALSE(fs::exists(out));
}

}  // namespace
}  // namespace bolo::tools::test
