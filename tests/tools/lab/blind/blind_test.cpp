// The blind check's score, its seal, and the process of its diagnosis.
#include "tools/lab/blind/blind.hpp"

#include "tests/tools/program.hpp"

namespace bolo::tools::blind::blind_test {

Finding said(const std::string& verdict, const std::vector<std::string>& effects) {
  Finding finding;
  finding.verdict = verdict;
  for (const std::string& name : effects) finding.effects.push_back({name, {}});
  return finding;
}

Trial trial(Kind kind, const std::vector<std::string>& hidden, Finding finding) {
  Trial out;
  out.session.kind = kind;
  for (const std::string& name : hidden) out.session.effects.push_back({name, "", {}});
  out.finding = std::move(finding);
  return out;
}

// What a judgement says, in words.
std::string words_of(const Judgement& j) {
  std::string all;
  for (const auto& [holds, word] : {std::pair{j.passed, "passed "},
                                    {j.exact, "exact "},
                                    {j.all_right, "all "},
                                    {j.false_effect, "false "},
                                    {j.flagged, "flagged "},
                                    {j.blamed, "blamed "},
                                    {j.nothing, "nothing "}}) {
    if (holds) all += word;
  }
  return all.substr(0, all.find_last_of(' '));
}

TEST(BlindScore, EachKindAsksForItsOwn) {
  struct Case {
    Kind kind;
    std::vector<std::string> hidden;
    const char* verdict;
    std::vector<std::string> said;
    const char* judgement;
  };
  for (const Case& c :
       {Case{Kind::kEffectFree, {}, "no_gap", {}, "passed exact nothing"},
        {Kind::kEffectFree, {}, "explained", {"iir"}, "false blamed"},
        {Kind::kEffectFree, {}, "unknown_effect", {}, "flagged"},
        // the right cause first
        {Kind::kSingle, {"iir"}, "explained", {"iir"}, "passed exact all"},
        {Kind::kSingle, {"iir"}, "explained", {"flicker", "iir"}, "all false blamed"},
        {Kind::kSingle, {"iir"}, "no_gap", {}, "nothing"},
        // both
        {Kind::kPair, {"iir", "drift"}, "explained", {"drift", "iir"}, "passed exact all"},
        {Kind::kPair, {"iir", "drift"}, "explained", {"drift", "iir", "rts"}, "passed all false blamed"},
        {Kind::kPair, {"iir", "drift"}, "explained", {"drift"}, ""},
        // a flag
        {Kind::kWithheld, {"iir"}, "unknown_effect", {}, "passed flagged"},
        {Kind::kOutside, {"iir"}, "partly_explained", {"drift"}, "passed false flagged"},
        {Kind::kWithheld, {"iir"}, "explained", {"tau_global"}, "false blamed"},
        {Kind::kOutside, {"iir"}, "no_gap", {}, "nothing"},
        // either
        {Kind::kForms, {"iir"}, "explained", {"iir"}, "passed exact all"},
        {Kind::kForms, {"iir"}, "partly_explained", {"drift"}, "passed false flagged"},
        {Kind::kForms, {"iir"}, "explained", {"drift"}, "false blamed"}}) {
    SCOPED_TRACE(std::string(name_of(c.kind)) + ", said " + c.verdict + " " + std::to_string(c.said.size()));
    EXPECT_EQ(words_of(judge(trial(c.kind, c.hidden, said(c.verdict, c.said)))), c.judgement);
  }
}

TEST(BlindScore, ABrokenDiagnosisIsNeverRight) {
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    Trial broken = trial(static_cast<Kind>(kind), {"iir"}, {});
    broken.finding.reset();
    const Judgement judgement = judge(broken);
    EXPECT_TRUE(judgement.broken);
    EXPECT_FALSE(judgement.passed || judgement.nothing);
  }
}

TEST(BlindScore, CountsIntervalsAndConfusion) {
  Trial good = trial(Kind::kSingle, {"iir"}, said("explained", {"iir"}));
  good.session.effects[0].values = {{"alpha", 0.75}};
  good.finding->effects[0].parameters = {{"alpha", {0.74, 0.72, 0.76}}};
  Trial off = good;
  off.finding->effects[0].parameters = {{"alpha", {0.7, 0.68, 0.72}}};
  const Trial wrong = trial(Kind::kSingle, {"iir"}, said("explained", {"drift"}));
  const Json all = score({good, off, wrong, trial(Kind::kOutside, {"iir"}, said("unknown_effect", {}))}, {});
  EXPECT_EQ(all.at("intervals").at("iir.alpha").at("all"), 2);
  EXPECT_EQ(all.at("intervals").at("iir.alpha").at("inside"), 1);
  EXPECT_EQ(all.at("confusion").at("iir").at("iir"), 2);
  EXPECT_EQ(all.at("confusion").at("iir").at("drift"), 1);
  EXPECT_EQ(all.at("said_instead").at("iir").at("?"), 1);
  const Json& single = all.at("kinds").at("single");
  EXPECT_EQ(single.at("right_first"), 2);
  ASSERT_EQ(all.at("failures").size(), 1U);
  EXPECT_EQ(all.at("failures")[0].at("said"), "explained: drift");
}

TEST(BlindScore, AFailureCanBeDrawnAgain) {
  EXPECT_EQ(rerun_words(Kind::kWithheld, 17, {.seed = 5, .frames_scale = 0.3, .imperfect = true}),
            "bolo-lab blind --kind withheld --seed 5 --first 17 --sessions 1 --imperfect --frames-scale 0.3");
}

TEST(BlindFinding, ReadsWhatAReportSays) {
  const auto finding = must(parse_finding(R"({"bolo_report": 1, "verdict": "explained", "seconds": 2.5,
      "effects": [{"name": "iir", "parameters": {"alpha": {"value": 0.7, "ci95": [0.6, null]}}}]})"));
  EXPECT_EQ(finding->verdict, "explained");
  EXPECT_EQ(finding->effects.at(0).name, "iir");
  EXPECT_EQ(finding->effects.at(0).parameters.at("alpha").low, 0.6);
  EXPECT_TRUE(std::isnan(finding->effects.at(0).parameters.at("alpha").high));
  EXPECT_FALSE(parse_finding("{}"));
  EXPECT_FALSE(parse_finding("not JSON"));
}

// --- the seal

std::vector<Session> two_sessions() {
  return {draw_session({}, Kind::kSingle, 0).value(), draw_session({}, Kind::kPair, 1).value()};
}

TEST(BlindSeal, DigestsAsTheStandardSays) {  // FIPS 180-4, examples of NIST
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(BlindSeal, RefusesAnswersThatWereChanged) {
  auto sessions = two_sessions();
  const auto seal = must(Seal::close(sessions));
  auto& values = sessions[0].effects.at(0).values;
  ASSERT_FALSE(values.empty());
  values.begin()->second *= 1.0 + 1e-12;
  EXPECT_FALSE(seal->open(sessions));
  sessions = two_sessions();
  sessions.pop_back();
  EXPECT_FALSE(seal->open(sessions));
}

TEST(BlindSeal, TheSameAnswersHaveAnotherDigestEachTime) {
  const auto sessions = two_sessions();
  EXPECT_NE(Seal::close(sessions)->digest(), Seal::close(sessions)->digest());
}

// --- the diagnosing process

// A program of one shell line in `folder`.
ChildWork work_of(const Scratch& folder, const std::string& line) {
  const auto program = folder / "program";
  std::ofstream(program) << "#!/bin/sh\n" << line << '\n';
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
  return {program, {folder / "capture-1.h5"}, folder / "report", "", 60.0};
}

const std::atomic<bool> kNever{false};

TEST(BlindChild, SaysWhyItFailed) {
  const Scratch folder;
  expect_error(run_child(work_of(folder, "echo nonsense >&2; exit 3"), kNever),
               {"the diagnosis ended with exit code 3: nonsense"});
  expect_error(run_child(work_of(folder, "kill -9 $$"), kNever), {"the diagnosis ended with signal 9"});
  ChildWork work = work_of(folder, "");
  work.program = folder / "nothing";
  EXPECT_FALSE(run_child(work, kNever));
}

TEST(BlindChild, IsEndedWhenItTakesTooLongOrIsNotWanted) {
  const Scratch folder;
  ChildWork work = work_of(folder, "exec sleep 300");
  work.limit_s = 0.2;
  expect_error(run_child(work, kNever), {"the diagnosis took too long"});
  work.limit_s = 300.0;
  expect_error(run_child(work, std::atomic<bool>{true}), {"interrupted"});
}

}  // namespace bolo::tools::blind::blind_test
