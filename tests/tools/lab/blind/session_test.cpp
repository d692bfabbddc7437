#include "tools/lab/blind/session.hpp"

#include "src/capture/capture.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
namespace bolo::tools::blind::session_test {

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

std::vector<std::uint16_t> frame(const CaptureReader& reader, std::size_t index) {
  std::vector<std::uint16_t> plane(reader.info().format.geometry.pixels());
  EXPECT_TRUE(reader.read_frame(index, plane.data()));
  return plane;
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
    return frame(*CaptureReader::open(folder / session.captures[0].file), 5);
  };
  const auto at_zero = at_phase(0.0);
  const auto moved = at_phase(3.0 / 20.0);                                                // of a period of 20 pixels
  for (std::size_t x = 3; x < 16; ++x) EXPECT_NEAR(moved[x], at_zero[x - 3], 40.0) << x;  // 0.4 K of noise
  EXPECT_GT(std::abs(moved[1] - at_zero[1]), 1000);
}

}  // namespace bolo::tools::blind::session_test
