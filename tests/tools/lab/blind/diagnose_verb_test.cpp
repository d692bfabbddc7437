#include <fstream>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "src/capture/pixel_maps_io.hpp"
#include "src/model/camera_profile.hpp"
#include "tests/tools/program.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::diagnose_verb_test {
namespace {

using nlohmann::json;
using test::Outcome;

class DiagnoseVerb : public test::ProgramTest {
 protected:
  DiagnoseVerb() : ProgramTest({BOLO_PROGRAM, "diagnose"}) {
    blind::DrawOptions options;
    options.geometry = {8, 8};
    options.frames_scale = 0.1;
    files_ = blind::write_captures(blind::draw_session(options, blind::Kind::kEffectFree, 0).value(), folder_).value();
  }

  std::vector<std::filesystem::path> files_;
};

TEST_F(DiagnoseVerb, WritesTheReportAndSaysWhatItFound) {
  const Outcome outcome = run({"-o", folder_ / "out", files_[0], files_[1]});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("Rows are sampled 28 us after one another"), std::string::npos) << outcome.out;
  EXPECT_NE(outcome.err.find("reading"), std::string::npos) << outcome.err;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/report.html"));
  const json report = json::parse(std::ifstream(folder_ / "out/report.json"));
  EXPECT_EQ(report.at("inputs").size(), 2U);
}

TEST_F(DiagnoseVerb, PrintsTheReportAsJson) {
  const Outcome outcome = run({"-o", folder_ / "out", "--json", "--withhold", "row_delay", files_[0]});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json printed = json::parse(outcome.out);
  EXPECT_EQ(printed.at("withheld"), json::array({"row_delay"}));
  EXPECT_EQ(printed.at("verdict"), "unknown_effect");
  EXPECT_EQ(printed, json::parse(std::ifstream(folder_ / "out/report.json")));
}

TEST_F(DiagnoseVerb, AFileNameMayHaveACommaAndBlanks) {
  const auto file = folder_ / "a, b.h5";
  std::filesystem::copy_file(files_[0], file);
  const Outcome outcome = run({"-o", folder_ / "out", "--json", file});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(json::parse(outcome.out).at("inputs"), json::array({file.string()}));
}

TEST_F(DiagnoseVerb, WritesAProfileWithWhatItFound) {
  const auto file = folder_ / "learned.toml";
  const Outcome outcome = run({"-o", folder_ / "out", "--write-profile", file, files_[0]});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("  profile     " + file.string() +
                             "\n              maps = \"learned.h5\"\n              row_delay_s = "),
            std::string::npos)
      << outcome.out;
  const auto profile = model::read_profile(file);
  ASSERT_TRUE(profile) << profile.error().message;
  EXPECT_EQ(profile->row_delay_s, 2.8e-5);
  EXPECT_EQ(profile->tau_s, 0.011);
  EXPECT_EQ(profile->maps, folder_ / "learned.h5") << "beside the profile";
  const auto maps = capture::read_profile_maps(*profile);
  ASSERT_TRUE(maps) << maps.error().message;
  EXPECT_EQ(maps->offset, (std::vector<float>{0.25F, -0.5F}));
  EXPECT_EQ(maps->row_delay_s, 2.8e-5);
  EXPECT_NE(test::contents(file).find("maps = \"learned.h5\""), std::string::npos)
      << "both files can be moved together";
}

TEST_F(DiagnoseVerb, WrongUsageIsOneLineAndTheExitCodeTwo) {
  const std::vector<std::vector<std::string>> wrong{
      {files_[0]},                                                             // no folder
      {"-o", folder_ / "out"},                                                 // no capture
      {"-o", folder_ / "out", folder_ / "missing.h5"},                         //
      {"-o", folder_ / "out", "--threads", "0", files_[0]},                    //
      {"-o", folder_ / "out", "--profile", folder_ / "none.toml", files_[0]},  //
      {"-o", files_[1] / "sub", files_[0]},                                    // a folder in a file
  };
  for (const auto& words : wrong) {
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.exit_code, 2) << words.back();
    const std::size_t last = outcome.err.rfind("bolo diagnose: ");
    ASSERT_NE(last, std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find('\n', last), outcome.err.size() - 1) << outcome.err;
  }
}

}  // namespace
}  // namespace bolo::tools::diagnose_verb_test
