// The blind check: its score, its seal, the process of its diagnosis; its sessions, and the second reality.
#include "tools/lab/blind/blind.hpp"
#include "tests/capture/frame_values.hpp"
#include "tests/tools/program.hpp"
#include "tools/lab/blind/session.hpp"

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

// A judgement in words.
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

// --- The sessions.

Session drawn(Kind kind, std::size_t index, const DrawOptions& options = {}) {
  return *must(draw_session(options, kind, index));
}

TEST(BlindSession, TheSameSeedDrawsTheSame) {
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    const auto k = static_cast<Kind>(kind);
    EXPECT_EQ(to_json(drawn(k, 3)), to_json(drawn(k, 3)));
    EXPECT_NE(to_json(drawn(k, 3))["captures"], to_json(drawn(k, 4))["captures"]);
    EXPECT_NE(to_json(drawn(k, 3))["captures"], to_json(drawn(k, 3, {.seed = 2}))["captures"]);
    EXPECT_EQ(kind_named(name_of(k)), k);
  }
  EXPECT_FALSE(kind_named("double"));
}

TEST(BlindSession, SinglesGoThroughTheWholeCatalogueWithRealisticParameters) {
  const auto effects = static_cast<std::size_t>(
      std::ranges::count(sim::effect_descriptions(), true, &sim::EffectDescription::in_catalogue));
  std::set<std::string> seen;
  for (std::size_t i = 0; i < 2 * effects; ++i) {
    const Session session = drawn(Kind::kSingle, i);
    ASSERT_EQ(session.effects.size(), 1U);
    const sim::EffectSpec& effect = session.effects[0];
    const auto* const description = sim::find_effect(effect.name);
    ASSERT_NE(description, nullptr);
    EXPECT_TRUE(description->in_catalogue);
    if (i < effects) seen.insert(effect.name);
    for (const sim::Parameter& parameter : description->parameters) {
      const auto found = effect.values.find(parameter.key);
      if (parameter.realistic.empty() || found == effect.values.end()) continue;
      EXPECT_TRUE(std::ranges::any_of(
          parameter.realistic,
          [&](const sim::Range& range) { return found->second >= range.low && found->second <= range.high; }))
          << effect.name << ' ' << parameter.key << ' ' << found->second;
    }
  }
  EXPECT_EQ(seen.size(), effects);
}

TEST(BlindSession, AKindHidesWhatItSays) {
  EXPECT_TRUE(drawn(Kind::kEffectFree, 0).effects.empty());
  const Session pair = drawn(Kind::kPair, 5);
  ASSERT_EQ(pair.effects.size(), 2U);
  EXPECT_NE(pair.effects[0].name, pair.effects[1].name);
  const Session withheld = drawn(Kind::kWithheld, 2);
  EXPECT_EQ(withheld.withheld, withheld.effects.at(0).name);
  EXPECT_TRUE(drawn(Kind::kSingle, 2).withheld.empty());
  const Session form = drawn(Kind::kForms, 0);
  const auto& forms = sim::find_effect(form.effects.at(0).name)->forms;
  EXPECT_NE(form.effects[0].form, forms.front());
  EXPECT_NE(std::ranges::find(forms, form.effects[0].form), forms.end());
}

TEST(BlindSession, OnlyOneEffectWhenAskedFor) {
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(drawn(Kind::kSingle, i, {.only = "row_delay"}).effects.at(0).name, "row_delay");
  }
  expect_refused(draw_session({.only = "no_such_effect"}, Kind::kSingle, 0), {"no_such_effect"});
}

TEST(BlindSession, SixCapturesThatSayNothingInTheirNames) {
  const Session session = drawn(Kind::kSingle, 1);
  ASSERT_EQ(session.captures.size(), 6U);
  std::size_t frames = 0;
  double last_s = -1.0;
  for (const CapturePlan& plan : session.captures) {
    frames += plan.frames;
    EXPECT_GT(plan.session_start_s, last_s);
    last_s = plan.session_start_s;
    EXPECT_EQ(plan.file.find(session.effects[0].name), std::string::npos);
  }
  EXPECT_NEAR(static_cast<double>(frames), 2000.0, 100.0);
  const auto& slow = std::get<capture::BarTarget>(session.captures[3].stimulus);
  const auto& fast = std::get<capture::BarTarget>(session.captures[4].stimulus);
  EXPECT_LT(slow.velocity_px_s * fast.velocity_px_s, 0.0);
  EXPECT_EQ(std::get<capture::BarTarget>(session.captures[5].stimulus).velocity_px_s, 0.0);
  EXPECT_EQ(std::get<capture::Chopper>(session.captures[2].stimulus).on_s.size(), 10U);
}

TEST(BlindSession, OnlyAnImperfectBenchHasErrors) {
  const Session perfect = drawn(Kind::kEffectFree, 1);
  const Session imperfect = drawn(Kind::kEffectFree, 1, {.imperfect = true});
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(perfect.captures[i].faults.level_k, 0.0);
    EXPECT_EQ(perfect.captures[i].faults.velocity, 0.0);
    EXPECT_GE(std::abs(imperfect.captures[i].faults.level_k), 0.1);
    EXPECT_LE(std::abs(imperfect.captures[i].faults.level_k), 1.0);
  }
  EXPECT_NE(perfect.captures[2].faults.start_s, 0.0);
  EXPECT_NE(perfect.captures[5].faults.phase, 0.0);
  EXPECT_GT(imperfect.captures[2].faults.sweep_s, 0.0);
  EXPECT_EQ(imperfect.captures[3].faults.edge_px, imperfect.captures[5].faults.edge_px);  // the same target
  EXPECT_EQ(imperfect.captures[5].faults.velocity, 0.0);                                  // a still target
}

TEST(BlindSession, WhatHappensOnceHappensInOneOrTwoCaptures) {
  std::set<int> counts;
  for (std::size_t index = 0; index < 40; ++index) {
    int count = 0;
    for (const CapturePlan& plan : drawn(Kind::kSingle, index, {.only = "nuc_freeze"}).captures) {
      if (plan.effects.empty()) continue;
      ++count;
      EXPECT_GT(plan.effects.front().values.at("at_s"), 0.0);
      EXPECT_LT(plan.effects.front().values.at("at_s"), 0.6 * static_cast<double>(plan.frames) * 0.005);
    }
    counts.insert(count);
  }
  EXPECT_EQ(counts, (std::set<int>{1, 2}));
  const Session all_the_time = drawn(Kind::kSingle, 0, {.only = "iir"});
  for (const CapturePlan& plan : all_the_time.captures) EXPECT_EQ(plan.effects.size(), 1U);
}

// --- the captures

using capture::CaptureReader;

Session short_session(Kind kind, const std::string& only, bool imperfect = false) {
  return draw_session({.geometry = {16, 12}, .frames_scale = 0.15, .imperfect = imperfect, .only = only}, kind, 0)
      .value();
}

TEST(BlindCaptures, SayNothingOfWhatIsHidden) {
  const Scratch folder;
  const Session session = short_session(Kind::kSingle, "row_delay", true);
  const auto files = must(write_captures(session, folder.path()));
  ASSERT_EQ(files->size(), 6U);
  for (std::size_t i = 0; i < files->size(); ++i) {
    const auto reader = must(CaptureReader::open((*files)[i]));
    EXPECT_TRUE(reader->attributes()->empty());
    EXPECT_TRUE(reader->events().empty());
    EXPECT_TRUE(reader->info().camera_serial.empty());
    EXPECT_FALSE(reader->info().has_truth);
    EXPECT_EQ(reader->info().frames, session.captures[i].frames);
    EXPECT_EQ(reader->frame_id().back(), session.captures[i].frames - 1);
    EXPECT_EQ(reader->info().format.scale.scale, 0.01);
  }
  const auto chopper = must(CaptureReader::open((*files)[2])->stimulus());
  EXPECT_EQ(std::get<capture::Chopper>(*chopper).cold_k, 295.0);  // nominal, without the true errors
}

TEST(BlindCaptures, TheStimulusStartsWhereItWasDrawn) {
  Session session = short_session(Kind::kEffectFree, "");
  session.captures = {session.captures[5]};  // the still target
  const auto at_phase = [&session](double phase) {
    const Scratch folder;
    session.captures[0].faults.phase = phase;
    EXPECT_TRUE(write_captures(session, folder.path()));
    return capture::testing::frame_values(*CaptureReader::open(folder / session.captures[0].file), 5);
  };
  const auto at_zero = at_phase(0.0);
  const auto moved = at_phase(3.0 / 20.0);                                                // of a period of 20 pixels
  for (std::size_t x = 3; x < 16; ++x) EXPECT_NEAR(moved[x], at_zero[x - 3], 40.0) << x;  // 0.4 K of noise
  EXPECT_GT(std::abs(moved[1] - at_zero[1]), 1000);
}

// --- The second reality against closed forms of the simplest cases.

Session in_second_reality(Kind kind, std::size_t index) {
  return draw_session({.geometry = {16, 12}, .reality = Reality::kSecond}, kind, index).value();
}

// Mean of the frame, K.
double mean_of(const std::vector<std::uint16_t>& counts, std::size_t frame) {
  constexpr std::size_t kPixels = 16 * 12;
  double sum = 0.0;
  for (std::size_t p = 0; p < kPixels; ++p) sum += counts[frame * kPixels + p] * 0.01;
  return sum / static_cast<double>(kPixels);
}

TEST(SecondReality, TheSameSeedGivesTheSameFrames) {
  const Session session = in_second_reality(Kind::kPair, 3);
  EXPECT_EQ(to_json(session), to_json(in_second_reality(Kind::kPair, 3)));
  EXPECT_EQ(second::film(session, session.captures[5]), second::film(session, session.captures[5]));
}

TEST(SecondReality, AStillFieldIsAtItsTemperature) {
  const Session session = in_second_reality(Kind::kEffectFree, 0);
  const auto counts = second::film(session, session.captures[0]);
  EXPECT_NEAR(mean_of(counts, 100), 299.0 - 0.005, 0.01);  // values are cut to counts of 10 mK
}

// tau dT/dt + T = T_ss: after a switch the frames' means fall as exp(-t / tau).
TEST(SecondReality, PixelsFollowTheirTimeConstant) {
  for (const double scale : {1.0, 0.9}) {
    Session session = in_second_reality(Kind::kEffectFree, 0);
    CapturePlan plan = session.captures[2];
    if (scale != 1.0) plan.effects.push_back({"tau_global", "", {{"scale", scale}}});
    const auto counts = second::film(session, plan);
    const auto& chopper = std::get<capture::Chopper>(plan.stimulus);
    const auto first = static_cast<std::size_t>(chopper.off_s[0] / 0.005) + 4;
    const double ratio = (mean_of(counts, first + 4) - 296.495) / (mean_of(counts, first) - 296.495);
    EXPECT_NEAR(-0.02 / std::log(ratio), 0.011 * scale, 0.011 * 0.02) << scale;
  }
}

TEST(SecondReality, EveryEffectOfTheCatalogueIsHidden) {
  for (const sim::EffectDescription& effect : sim::effect_descriptions()) {
    const DrawOptions options{.only = std::string(effect.name), .reality = Reality::kSecond};
    EXPECT_TRUE(!effect.in_catalogue || draw_session(options, Kind::kSingle, 0)) << effect.name;
  }
}

// Using them would make it dependent.
TEST(SecondReality, UsesNeitherSimulatorNorDiagnosis) {
  for (const char* name : {"reality.cpp", "reality_draw.cpp", "reality_scene.cpp", "reality.hpp"}) {
    const std::string text = test::contents(std::filesystem::path(BOLO_SOURCE_DIR) / "tools/lab/blind" / name);
    EXPECT_FALSE(text.empty()) << name;
    EXPECT_EQ(text.find("#include \"src/sim"), std::string::npos) << name;
    EXPECT_EQ(text.find("#include \"src/diagnose"), std::string::npos) << name;
  }
}

}  // namespace bolo::tools::blind::blind_test
