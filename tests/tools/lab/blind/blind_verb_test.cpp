#include <fstream>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/scratch.hpp"
#include "tests/tools/program.hpp"
#include "tools/lab/blind/blind.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools {
namespace {

using nlohmann::json;
using test::Outcome;

Outcome run_blind(const Scratch& folder, const std::vector<std::string>& words) {
  std::vector<std::string> all{BOLO_PROGRAM, "blind",    "--bolo", BOLO_PROGRAM,     "--width",
                               "8",          "--height", "8",      "--frames-scale", "0.1"};
  all.insert(all.end(), words.begin(), words.end());
  return test::Program(folder.path(), all).outcome();
}

TEST(BlindVerb, SealsDiagnosesOpensAndScores) {
  const Scratch folder;
  const Outcome outcome = run_blind(folder, {"--kind", "single", "--only", "row_delay", "--sessions", "2"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::size_t sealed = outcome.out.find("sealed 2 answers: sha256 ");
  const std::size_t opened = outcome.out.find("opened: the answers are those that were sealed");
  ASSERT_NE(sealed, std::string::npos) << outcome.out;
  EXPECT_LT(sealed, opened);
  EXPECT_NE(outcome.out.find("passed 2 of 2"), std::string::npos) << outcome.out;
  EXPECT_NE(outcome.out.find("row_delay.row_delay_s"), std::string::npos) << outcome.out;
}

TEST(BlindVerb, ScoresEveryKindAsJson) {
  const Scratch folder;
  const Outcome outcome = run_blind(folder, {"--sessions", "1", "--json", "--imperfect"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json score = json::parse(outcome.out);
  EXPECT_EQ(score.at("kinds").size(), blind::kKinds);
  EXPECT_EQ(score.at("kinds").at("effect-free").at("false_effect"), 1);  // the made-up diagnosis always says row_delay
  EXPECT_EQ(score.at("kinds").at("withheld").at("flagged"), 1);
  EXPECT_EQ(score.at("imperfect"), true);
  EXPECT_EQ(score.at("sealed_sha256").get<std::string>().size(), 64U);
}

TEST(BlindVerb, TheChildCannotSeeTheAnswers) {
  const Scratch folder;
  const auto keep = folder / "kept";
  const Outcome outcome = run_blind(
      folder, {"--kind", "single", "--only", "iir", "--sessions", "1", "--seed", "424242", "--keep", keep.string()});
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

TEST(BlindVerb, KeptAnswersMatchTheSeal) {
  const Scratch folder;
  const auto keep = folder / "kept";
  const Outcome outcome =
      run_blind(folder, {"--kind", "effect-free", "--sessions", "1", "--json", "--keep", keep.string()});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::string digest = json::parse(outcome.out).at("sealed_sha256");
  EXPECT_EQ(blind::sha256(test::contents(keep / "answers.json") + test::contents(keep / "nonce.txt")), digest);
  EXPECT_NE(outcome.err.find(digest), std::string::npos);  // shown before
  EXPECT_TRUE(std::filesystem::exists(keep / "effect-free-0" / "report" / "report.html"));
}

TEST(BlindVerb, OneSessionDrawnAgainIsTheSame) {
  const Scratch folder;
  ASSERT_EQ(run_blind(folder, {"--kind", "pair", "--sessions", "3", "--keep", (folder / "a").string()}).exit_code, 0);
  ASSERT_EQ(run_blind(folder, {"--kind", "pair", "--first", "2", "--sessions", "1", "--keep", (folder / "b").string()})
                .exit_code,
            0);
  const json all = json::parse(std::ifstream(folder / "a" / "answers.json"));
  const json one = json::parse(std::ifstream(folder / "b" / "answers.json"));
  EXPECT_EQ(all.at(2), one.at(0));
}

TEST(BlindVerb, WrongUsageIsRefused) {
  const Scratch folder;
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{{"--kind", "double"},
                                                                                     {"--sessions", "0"},
                                                                                     {"--jobs", "0"},
                                                                                     {"--magnitude", "0"},
                                                                                     {"--frames-scale", "100"},
                                                                                     {"--only", "nothing"}}) {
    const Outcome outcome = run_blind(folder, words);
    EXPECT_EQ(outcome.exit_code, 2) << words[0];
    EXPECT_NE(outcome.err.find("bolo-lab blind: "), std::string::npos) << outcome.err;
  }
}

}  // namespace
}  // namespace bolo::tools
