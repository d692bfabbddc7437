#include <fstream>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"
#include "tools/lab/blind/blind.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind_verb_test {
namespace {

using nlohmann::json;
using test::Outcome;

struct BlindVerb : test::ProgramTest {
  BlindVerb()
      : ProgramTest({BOLO_PROGRAM, "blind", "--bolo", BOLO_PROGRAM, "--width", "8", "--height", "8", "--frames-scale",
                     "0.1"}) {}
};

TEST_F(BlindVerb, SealsDiagnosesOpensAndScores) {
  const Outcome outcome = run({"--kind", "single", "--only", "row_delay", "--sessions", "2"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::size_t sealed = outcome.out.find("sealed 2 answers: sha256 ");
  const std::size_t opened = outcome.out.find("opened: the answers are those that were sealed");
  ASSERT_NE(sealed, std::string::npos) << outcome.out;
  EXPECT_LT(sealed, opened);
  EXPECT_NE(outcome.out.find("passed 2 of 2"), std::string::npos) << outcome.out;
  EXPECT_NE(outcome.out.find("row_delay.row_delay_s"), std::string::npos) << outcome.out;
}

TEST_F(BlindVerb, ScoresEveryKindAsJson) {
  const Outcome outcome = run({"--sessions", "1", "--json", "--imperfect"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json score = json::parse(outcome.out);
  EXPECT_EQ(score.at("kinds").size(), blind::kKinds);
  EXPECT_EQ(score.at("kinds").at("effect-free").at("false_effect"), 1);  // the made-up diagnosis always says row_delay
  EXPECT_EQ(score.at("kinds").at("withheld").at("flagged"), 1);
  EXPECT_EQ(score.at("imperfect"), true);
  EXPECT_EQ(score.at("sealed_sha256").get<std::string>().size(), 64U);
}

TEST_F(BlindVerb, TheChildCannotSeeTheAnswers) {
  const auto keep = folder_ / "kept";
  const Outcome outcome =
      run({"--kind", "single", "--only", "iir", "--sessions", "1", "--seed", "424242", "--keep", keep.string()});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::string seen = test::contents(keep / "single-0" / "seen.txt");
  ASSERT_NE(seen.find("capture-1.h5"), std::string::npos);
  for (const char* hint : {"iir", "single", "424242", "answers"}) {
    EXPECT_EQ(seen.find(hint), std::string::npos) << hint << " in\n" << seen;
  }
  // Its own three, what it reads of /proc, and the file in which it writes this down.
  std::size_t open_files = 0;
  for (std::size_t at = seen.find("fd "); at != std::string::npos; at = seen.find("fd ", at + 1)) ++open_files;
  EXPECT_LE(open_files, 6U) << seen;
  EXPECT_NE(test::contents(keep / "answers.json").find("iir"), std::string::npos);
}

TEST_F(BlindVerb, KeptAnswersMatchTheSeal) {
  const auto keep = folder_ / "kept";
  const Outcome outcome = run({"--kind", "effect-free", "--sessions", "1", "--json", "--keep", keep.string()});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::string digest = json::parse(outcome.out).at("sealed_sha256");
  EXPECT_EQ(blind::sha256(test::contents(keep / "answers.json") + test::contents(keep / "nonce.txt")), digest);
  EXPECT_NE(outcome.err.find(digest), std::string::npos);  // shown before
  EXPECT_TRUE(std::filesystem::exists(keep / "effect-free-0" / "report" / "report.html"));
}

TEST_F(BlindVerb, OneSessionDrawnAgainIsTheSame) {
  ASSERT_EQ(run({"--kind", "pair", "--sessions", "3", "--keep", (folder_ / "a").string()}).exit_code, 0);
  ASSERT_EQ(run({"--kind", "pair", "--first", "2", "--sessions", "1", "--keep", (folder_ / "b").string()}).exit_code,
            0);
  const json all = json::parse(std::ifstream(folder_ / "a" / "answers.json"));
  const json one = json::parse(std::ifstream(folder_ / "b" / "answers.json"));
  EXPECT_EQ(all.at(2), one.at(0));
}

TEST_F(BlindVerb, WrongUsageIsRefused) {
  for (const auto& words : {std::vector<std::string>{"--kind", "double"},
                            {"--sessions", "0"},
                            {"--jobs", "0"},
                            {"--magnitude", "0"},
                            {"--frames-scale", "100"},
                            {"--only", "nothing"}}) {
    refused(words, "bolo-lab blind: ");
  }
}

}  // namespace
}  // namespace bolo::tools::blind_verb_test
