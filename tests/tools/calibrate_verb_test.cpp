// `bolo calibrate` as its users meet it.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "src/capture/pixel_maps_io.hpp"
#include "src/model/camera_profile.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

namespace fs = std::filesystem;

class Calibrate : public ProgramTest {
 protected:
  Calibrate() : ProgramTest({BOLO_PROGRAM}) {}

  void simulate(const std::string& name, std::vector<std::string> more) const {
    std::vector<std::string> words{"simulate", "-o", file(name),   "--width",       "32",
                                   "--height", "24", "--no-truth", "--camera-seed", "5"};
    words.insert(words.end(), more.begin(), more.end());
    done(words);
  }
};

TEST_F(Calibrate, WritesProfileMapsAndPicture) {
  simulate("chopper.h5", {"--stimulus", "chopper", "--effect", "tau_spread:rms=0.05", "--tau", "0.0105"});
  simulate("shutter.h5", {"--stimulus", "uniform", "--effect", "fpn_offset", "--frames", "100"});
  const Outcome fitted = run({"calibrate", file("chopper.h5"), file("shutter.h5"), "-o", file("mine.toml"), "--plot",
                              file("fit.svg"), "--json"});
  ASSERT_EQ(fitted.exit_code, 0) << fitted.err;
  const auto json = nlohmann::json::parse(fitted.out);
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

  const auto profile = model::read_profile(file("mine.toml"));
  ASSERT_TRUE(profile) << profile.error().message;
  const double low = json.at("tau_ci95")[0];
  const double high = json.at("tau_ci95")[1];
  EXPECT_NEAR(profile->tau_s, tau_s, 0.05 * (high - low));
  std::stringstream text;
  text << std::ifstream(file("mine.toml")).rdbuf();
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
  EXPECT_GT(fs::file_size(file("fit.svg")), 10000U);

  // What was written is what the deblurring takes.
  done({"deblur", file("chopper.h5"), "-o", file("sharp.h5"), "--profile", file("mine.toml")});
}

TEST_F(Calibrate, StartsFromAProfileAndPutsMapsWhereAsked) {
  simulate("chopper.h5", {"--stimulus", "chopper", "--effect", "tau_spread"});
  write("old.toml", "row_delay_s = 2.5e-5\n");
  const Outcome fitted = run({"calibrate", file("chopper.h5"), "-o", file("mine.toml"), "--profile", file("old.toml"),
                              "--maps", file("pixels.h5")});
  ASSERT_EQ(fitted.exit_code, 0) << fitted.err;
  EXPECT_NE(fitted.out.find("tau  "), std::string::npos);
  const auto profile = model::read_profile(file("mine.toml"));
  ASSERT_TRUE(profile) << profile.error().message;
  EXPECT_EQ(profile->row_delay_s, 2.5e-5);
  EXPECT_TRUE(fs::exists(file("pixels.h5")));
  EXPECT_EQ(fs::weakly_canonical(profile->maps), fs::weakly_canonical(file("pixels.h5")));
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
  const std::string out = file("never.toml");
  const std::vector<Case> cases{
      {{"calibrate"}, "give -o"},
      {{"calibrate", "-o", out}, "which captures"},
      {{"calibrate", file("none.h5"), "-o", out}, "none.h5"},
      {{"calibrate", file("shutter.h5"), "-o", out}, "no capture with pulses"},
      {{"calibrate", file("pan.h5"), "-o", out}, "no rectangular pulses"},
      {{"calibrate", file("chopper.h5"), file("bigger.h5"), "-o", out}, "another size"},
      {{"calibrate", file("chopper.h5"), file("pan.h5"), "-o", out}, "no still field"},
      {{"calibrate", file("chopper.h5"), "-o", out, "--profile", file("none.toml")}, "none.toml"},
      {{"calibrate", file("chopper.h5"), "-o", file("nowhere/mine.toml")}, "nowhere/mine.toml"},
      {{"calibrate", file("chopper.h5"), "-o", out, "--threads", "2"}, "threads"}};
  for (const Case& one : cases) refused(one.words, one.says);
  EXPECT_FALSE(fs::exists(out));
}

}  // namespace
}  // namespace bolo::tools::test
