#include <nlohmann/json.hpp>
#include <regex>
#include "src/capture/pixel_maps_io.hpp"
#include "src/model/camera_profile.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test::calibrate_verb_test {

namespace fs = std::filesystem;

class Calibrate : public ProgramTest {
 protected:
  Calibrate() : ProgramTest({BOLO_PROGRAM}) {}

  void simulate(const std::string& name, const std::string& line) const {
    done(words("simulate -o @" + name + " --width 32 --height 24 --no-truth --camera-seed 5 " + line));
  }
};

TEST_F(Calibrate, WritesProfileMapsAndPicture) {
  simulate("chopper.h5", "--stimulus chopper --effect tau_spread:rms=0.05 --tau 0.0105");
  simulate("shutter.h5", "--stimulus uniform --effect fpn_offset --frames 100");
  const auto json =
      nlohmann::json::parse(printed(words("calibrate @chopper.h5 @shutter.h5 -o @mine.toml --plot @fit.svg --json")));
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

  const auto profile = must(model::read_profile(file("mine.toml")));
  const double low = json.at("tau_ci95")[0];
  const double high = json.at("tau_ci95")[1];
  EXPECT_NEAR(profile->tau_s, tau_s, 0.05 * (high - low));
  const std::string text = contents(file("mine.toml"));
  expect_parts(text, {"# 0.0001 to 1 s; measured, 95 % interval 0.01", "# 0 to 100 K; measured\n",
                      "; default \"FLIR A655sc\"\nmodel = \"Bolo"});
  EXPECT_FALSE(std::regex_search(text, std::regex("\\.[0-9]{11}"))) << "more digits than are known: " << text;
  EXPECT_EQ(profile->maps.filename(), "mine-maps.h5");
  const auto maps = must(capture::read_profile_maps(*profile));
  EXPECT_EQ(maps->tau_s.size(), 32U * 24U);
  EXPECT_EQ(maps->offset.size(), 32U * 24U);
  EXPECT_GT(fs::file_size(file("fit.svg")), 10000U);

  // `bolo deblur` accepts the written profile.
  done(words("deblur @chopper.h5 -o @sharp.h5 --profile @mine.toml"));
}

TEST_F(Calibrate, StartsFromAProfileAndPutsMapsWhereAsked) {
  simulate("chopper.h5", "--stimulus chopper --effect tau_spread");
  write("old.toml", "row_delay_s = 2.5e-5\n");
  expect_parts(printed(words("calibrate @chopper.h5 -o @mine.toml --profile @old.toml --maps @pixels.h5")), {"tau  "});
  const auto profile = must(model::read_profile(file("mine.toml")));
  EXPECT_EQ(profile->row_delay_s, 2.5e-5);
  EXPECT_TRUE(fs::exists(file("pixels.h5")));
  EXPECT_EQ(fs::weakly_canonical(profile->maps), fs::weakly_canonical(file("pixels.h5")));
}

TEST_F(Calibrate, TwoStillFieldsWithoutAPatternMakeNoMap) {
  simulate("chopper.h5", "--stimulus chopper");
  simulate("shutter.h5", "--stimulus uniform --frames 100");
  simulate("hot.h5", "--stimulus uniform --frames 100 --seed 2 --temperature 320");
  const auto text = printed(words("calibrate @chopper.h5 @shutter.h5 @hot.h5 -o @mine.toml"));
  EXPECT_FALSE(fs::exists(file("mine-maps.h5"))) << text;
  expect_parts(text, {"still field  noise 0.03", " K (", " K rms\n"});
}

TEST_F(Calibrate, SaysWhatIsWrongInOneLine) {
  simulate("shutter.h5", "--stimulus uniform --frames 60");
  simulate("pan.h5", "--frames 120");
  simulate("bigger.h5", "--width 40 --stimulus uniform --frames 20");
  simulate("chopper.h5", "--stimulus chopper --frames 120");
  for (const auto& [line, message] : {std::pair{"", "give -o"},
                                      {"-o @never.toml", "which captures"},
                                      {"-o @never.toml @none.h5", "none.h5"},
                                      {"-o @never.toml @shutter.h5", "no capture with pulses"},
                                      {"-o @never.toml @pan.h5", "no rectangular pulses"},
                                      {"-o @never.toml @chopper.h5 @bigger.h5", "another size"},
                                      {"-o @never.toml @chopper.h5 @pan.h5", "no still field"},
                                      {"-o @never.toml @chopper.h5 --profile @none.toml", "none.toml"},
                                      {"-o @nowhere/mine.toml @chopper.h5", "nowhere/mine.toml"},
                                      {"-o @never.toml @chopper.h5 --threads 2", "threads"}}) {
    refused(words(std::string("calibrate ") + line), message);
  }
  EXPECT_FALSE(fs::exists(file("never.toml")));
}

}  // namespace bolo::tools::test::calibrate_verb_test
