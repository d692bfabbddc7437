// The blind check's score, its seal, and the process of its diagnosis.
#include "tools/lab/blind/blind.hpp"

#include "tests/refusal.hpp"
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

TEST(BlindScore, EffectFreeAsksForSilence) {
  const Judgement silent = judge(trial(Kind::kEffectFree, {}, said("no_gap", {})));
  EXPECT_TRUE(silent.passed && !silent.false_effect);
  const Judgement alarm = judge(trial(Kind::kEffectFree, {}, said("explained", {"iir"})));
  EXPECT_TRUE(!alarm.passed && alarm.false_effect);
  const Judgement unknown = judge(trial(Kind::kEffectFree, {}, said("unknown_effect", {})));
  EXPECT_TRUE(!unknown.passed && unknown.flagged);
}

TEST(BlindScore, ASingleAsksForTheRightCauseFirst) {
  const auto judged = [](const Finding& finding) { return judge(trial(Kind::kSingle, {"iir"}, finding)); };
  const Judgement right = judged(said("explained", {"iir"}));
  EXPECT_TRUE(right.passed && right.exact);
  const Judgement second = judged(said("explained", {"flicker", "iir"}));
  EXPECT_TRUE(second.all_right && second.false_effect);
  EXPECT_FALSE(second.passed || second.exact);
  EXPECT_TRUE(judged(said("no_gap", {})).nothing);
}

TEST(BlindScore, APairAsksForBoth) {
  const auto judged = [](const std::vector<std::string>& effects) {
    return judge(trial(Kind::kPair, {"iir", "drift"}, said("explained", effects)));
  };
  EXPECT_TRUE(judged({"drift", "iir"}).passed);
  const Judgement more = judged({"drift", "iir", "rts"});
  EXPECT_TRUE(more.passed && !more.exact);
  EXPECT_FALSE(judged({"drift"}).passed);
}

TEST(BlindScore, OutsideAndWithheldAskForAFlag) {
  EXPECT_TRUE(judge(trial(Kind::kWithheld, {"iir"}, said("unknown_effect", {}))).passed);
  EXPECT_TRUE(judge(trial(Kind::kOutside, {"iir"}, said("partly_explained", {"drift"}))).passed);
  const Judgement blamed = judge(trial(Kind::kWithheld, {"iir"}, said("explained", {"tau_global"})));
  EXPECT_FALSE(blamed.passed);
  EXPECT_TRUE(blamed.blamed);
  const Judgement silent = judge(trial(Kind::kOutside, {"iir"}, said("no_gap", {})));
  EXPECT_TRUE(silent.nothing);
  EXPECT_FALSE(silent.passed || silent.blamed);
}

TEST(BlindScore, AFormMayBeNamedOrFlagged) {
  EXPECT_TRUE(judge(trial(Kind::kForms, {"iir"}, said("explained", {"iir"}))).passed);
  EXPECT_TRUE(judge(trial(Kind::kForms, {"iir"}, said("partly_explained", {"drift"}))).passed);
  EXPECT_FALSE(judge(trial(Kind::kForms, {"iir"}, said("explained", {"drift"}))).passed);
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

TEST(BlindSeal, OpensForTheSameAnswers) {
  const auto sessions = two_sessions();
  const auto seal = must(Seal::close(sessions));
  const auto opened = must(seal->open(two_sessions()));
  EXPECT_EQ(sha256(opened->answers + opened->nonce), seal->digest());
  EXPECT_EQ(opened->nonce.size(), 64U);
  EXPECT_EQ(nlohmann::json::parse(opened->answers).at(1).at("kind"), "pair");
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

TEST(BlindChild, GetsTheWordsOfADiagnosis) {
  const Scratch folder;
  ChildWork work = work_of(folder, "echo \"$@\" >&2");
  work.withheld = "iir";
  ASSERT_TRUE(run_child(work, kNever));
  expect_parts(test::contents(folder / "diagnose.err"),
               {"diagnose -o " + (folder / "report").string() + " --threads 1 --withhold iir " +
                (folder / "capture-1.h5").string() + "\n"});
}

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
