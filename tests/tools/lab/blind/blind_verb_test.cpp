#include <nlohmann/json.hpp>

#include "src/capture/pixel_maps_io.hpp"
#include "src/model/camera_profile.hpp"
#include "tests/tools/program.hpp"
#include "tools/lab/blind/blind.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::test::blind_verb_test {

using nlohmann::json;

struct BlindVerb : ProgramTest {
  BlindVerb()
      : ProgramTest({BOLO_PROGRAM, "blind", "--bolo", BOLO_PROGRAM, "--width", "8", "--height", "8", "--frames-scale",
                     "0.1"}) {}
};

TEST_F(BlindVerb, SealsDiagnosesOpensAndScores) {
  const std::string out = printed(words("--kind single --only row_delay --sessions 2"));
  expect_parts(out, {"sealed 2 answers: sha256 ", "kinds\n", "row_delay.row_delay_s    2       2\n"});
  EXPECT_LT(out.find("sealed 2 answers: sha256 "), out.find("opened: the answers are those that were sealed")) << out;
}

TEST_F(BlindVerb, ScoresEveryKindAsJson) {
  const json score = json::parse(printed(words("--sessions 1 --json --imperfect")));
  EXPECT_EQ(score.at("kinds").size(), blind::kKinds);
  EXPECT_EQ(score.at("kinds").at("effect-free").at("false_effect"), 1);  // from the made-up diagnosis: row_delay
  EXPECT_EQ(score.at("kinds").at("withheld").at("flagged"), 1);
  EXPECT_EQ(score.at("imperfect"), true);
  EXPECT_EQ(score.at("sealed_sha256").get<std::string>().size(), 64U);
}

TEST_F(BlindVerb, TheChildCannotSeeTheAnswers) {
  done(words("--kind single --only iir --sessions 1 --seed 424242 --keep @kept"));
  const std::string seen = contents(folder_ / "kept/single-0/seen.txt");
  expect_parts(seen, {"capture-1.h5"});
  expect_none(seen, {"iir", "single", "424242", "answers"});
  EXPECT_LE(count_of(seen, "fd "), 6U) << "standard streams, /proc, and its output file: " << seen;
  expect_parts(contents(folder_ / "kept/answers.json"), {"iir"});
}

TEST_F(BlindVerb, KeptAnswersMatchTheSeal) {
  const auto keep = folder_ / "kept";
  const Outcome outcome = run(words("--kind effect-free --sessions 1 --json --keep @kept"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::string digest = json::parse(outcome.out).at("sealed_sha256");
  EXPECT_EQ(blind::sha256(contents(keep / "answers.json") + contents(keep / "nonce.txt")), digest);
  expect_parts(outcome.err, {digest});  // published before
  EXPECT_TRUE(std::filesystem::exists(keep / "effect-free-0" / "report" / "report.html"));
}

TEST_F(BlindVerb, OneSessionDrawnAgainIsTheSame) {
  done(words("--kind pair --sessions 3 --keep @a"));
  done(words("--kind pair --first 2 --sessions 1 --keep @b"));
  EXPECT_EQ(json::parse(contents(folder_ / "a/answers.json")).at(2),
            json::parse(contents(folder_ / "b/answers.json")).at(0));
}

TEST_F(BlindVerb, WrongUsageIsRefused) {
  refused_each("", "--kind double", "--sessions 0", "--jobs 0", "--frames-scale 100", "--only nothing");
}

class DiagnoseVerb : public ProgramTest {
 protected:
  DiagnoseVerb() : ProgramTest({BOLO_PROGRAM, "diagnose"}) {
    const blind::DrawOptions options{.geometry = {8, 8}, .frames_scale = 0.1};
    files_ = blind::write_captures(blind::draw_session(options, blind::Kind::kEffectFree, 0).value(), folder_).value();
  }

  std::vector<std::filesystem::path> files_;
};

TEST_F(DiagnoseVerb, WritesTheReportAndSaysWhatItFound) {
  const Outcome outcome = run({"-o", folder_ / "out", files_[0], files_[1]});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  expect_parts(outcome.out, {"Rows are sampled 28 us after one another"});
  EXPECT_EQ(outcome.err, "diagnose:  60 %  noise\n");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/report.html"));
  EXPECT_EQ(json::parse(contents(folder_ / "out/report.json")).at("inputs").size(), 2U);
}

// Refused before any capture is read.
TEST_F(DiagnoseVerb, APlaceThatTakesNoReportIsRefusedAtOnce) {
  using Words = std::vector<std::string>;
  const Words profile{"-o", folder_ / "out", "--write-profile", folder_ / "missing" / "p.toml"};
  for (Words words : {Words{"-o", files_[0]}, profile}) {
    words.push_back(folder_ / "missing.h5");
    ended(2, words, {"choose another"});
  }
  ended(2, {"-o", folder_ / "out", "--write-profile", "", files_[0]}, {"no file for the profile"});
}

// A file name may contain commas and spaces.
TEST_F(DiagnoseVerb, PrintsTheReportAsJson) {
  const std::string file = folder_ / "a, b.h5";
  std::filesystem::copy_file(files_[0], file);
  const json told = json::parse(printed({"-o", folder_ / "out", "--json", "--withhold", "row_delay", file}));
  EXPECT_EQ(told.at("withheld"), json::array({"row_delay"}));
  EXPECT_EQ(told.at("verdict"), "unknown_effect");
  EXPECT_EQ(told.at("inputs"), json::array({file}));
  EXPECT_EQ(told, json::parse(contents(folder_ / "out/report.json")));
}

TEST_F(DiagnoseVerb, WritesAProfileWithWhatItFound) {
  const std::string file = folder_ / "learned.toml";
  expect_parts(printed({"-o", folder_ / "out", "--write-profile", file, files_[0]}),
               {"  profile     " + file + "\n              maps = \"learned-maps.h5\"\n              row_delay_s = "});
  const auto profile = must(model::read_profile(file));
  EXPECT_EQ(profile->row_delay_s, 2.8e-5);
  EXPECT_EQ(profile->tau_s, 0.011);
  EXPECT_EQ(profile->maps, folder_ / "learned-maps.h5") << "beside the profile";
  const auto maps = must(capture::read_profile_maps(*profile));
  EXPECT_EQ(maps->offset, (std::vector<float>{0.25F, -0.5F}));
  EXPECT_EQ(maps->row_delay_s, 2.8e-5);
  expect_parts(contents(file), {"maps = \"learned-maps.h5\""});  // relative: both files can be moved
}

TEST_F(DiagnoseVerb, WrongUsageIsOneLineAndTheExitCodeTwo) {
  const std::string file = files_[0];
  for (const std::string& line :
       {file /* no folder */, std::string("-o @out") /* no capture */, std::string("-o @out @missing.h5"),
        "-o @out --threads 0 " + file, "-o @out --profile @none.toml " + file,
        "-o " + files_[1].string() + "/sub " + file /* a folder in a file */}) {
    refused(words(line), "bolo diagnose: ");
  }
}

}  // namespace bolo::tools::test::blind_verb_test
