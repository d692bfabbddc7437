#include "tools/lab/blind/session.hpp"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>

namespace bolo::tools::blind::session_test {
namespace {

Session drawn(Kind kind, std::size_t index, const DrawOptions& options = {}) {
  auto session = draw_session(options, kind, index);
  EXPECT_TRUE(session) << session.error().message;
  return session.value_or(Session{});
}

TEST(BlindSession, TheSameSeedDrawsTheSame) {
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    const auto k = static_cast<Kind>(kind);
    EXPECT_EQ(to_json(drawn(k, 3)), to_json(drawn(k, 3)));
    EXPECT_NE(to_json(drawn(k, 3))["captures"], to_json(drawn(k, 4))["captures"]);
  }
  DrawOptions other;
  other.seed = 2;
  EXPECT_NE(to_json(drawn(Kind::kSingle, 3, other))["captures"], to_json(drawn(Kind::kSingle, 3))["captures"]);
}

TEST(BlindSession, SinglesGoThroughTheWholeCatalogue) {
  const auto names = effects_of(Kind::kSingle);
  std::set<std::string> seen;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const Session session = drawn(Kind::kSingle, i);
    ASSERT_EQ(session.effects.size(), 1U);
    const auto* const description = sim::find_effect(session.effects[0].name);
    ASSERT_NE(description, nullptr);
    EXPECT_TRUE(description->in_catalogue);
    seen.insert(session.effects[0].name);
  }
  EXPECT_EQ(seen.size(), names.size());
}

TEST(BlindSession, ParametersAreRealistic) {
  for (std::size_t i = 0; i < 2 * effects_of(Kind::kSingle).size(); ++i) {
    const sim::EffectSpec effect = drawn(Kind::kSingle, i).effects[0];
    for (const sim::Parameter& parameter : sim::find_effect(effect.name)->parameters) {
      const auto found = effect.values.find(parameter.key);
      if (parameter.realistic.empty() || found == effect.values.end()) continue;
      EXPECT_TRUE(std::ranges::any_of(
          parameter.realistic,
          [&](const sim::Range& range) { return found->second >= range.low && found->second <= range.high; }))
          << effect.name << ' ' << parameter.key << ' ' << found->second;
    }
  }
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
  DrawOptions options;
  options.only = "row_delay";
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(drawn(Kind::kSingle, i, options).effects.at(0).name, "row_delay");
  options.only = "no_such_effect";
  const auto none = draw_session(options, Kind::kSingle, 0);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(none.error().message.find("no_such_effect"), std::string::npos);
}

TEST(BlindSession, AWeakerEffectIsNearerToNothing) {
  const sim::EffectSpec tau{"tau_global", "", {{"scale", 1.2}}};
  EXPECT_NEAR(weakened(tau, 0.1).values.at("scale"), 1.02, 1e-12);
  const sim::EffectSpec delay{"row_delay", "", {{"row_delay_s", 3e-5}}};
  EXPECT_NEAR(weakened(delay, 0.33).values.at("row_delay_s"), 0.99e-5, 1e-12);
  EXPECT_EQ(weakened(delay, 1.0), delay);
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
  DrawOptions options;
  options.imperfect = true;
  const Session imperfect = drawn(Kind::kEffectFree, 1, options);
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
  EXPECT_EQ(imperfect.captures[5].faults.velocity, 0.0);                                  // it stands still
}

TEST(BlindSession, WhatHappensOnceHappensInOneOrTwoCaptures) {
  DrawOptions options;
  options.only = "nuc_freeze";
  std::set<int> counts;
  for (std::size_t index = 0; index < 40; ++index) {
    const Session session = drawn(Kind::kSingle, index, options);
    int count = 0;
    for (const CapturePlan& plan : session.captures) {
      if (plan.effects.empty()) continue;
      ++count;
      EXPECT_GT(plan.effects.front().values.at("at_s"), 0.0);
      EXPECT_LT(plan.effects.front().values.at("at_s"), 0.6 * static_cast<double>(plan.frames) * 0.005);
    }
    counts.insert(count);
  }
  EXPECT_EQ(counts, (std::set<int>{1, 2}));
  options.only = "iir";
  const Session all_the_time = drawn(Kind::kSingle, 0, options);
  for (const CapturePlan& plan : all_the_time.captures) EXPECT_EQ(plan.effects.size(), 1U);
}

TEST(BlindSession, KindsHaveNamesBothWays) {
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    EXPECT_EQ(kind_named(name_of(static_cast<Kind>(kind))), static_cast<Kind>(kind));
  }
  EXPECT_FALSE(kind_named("double"));
}

}  // namespace
}  // namespace bolo::tools::blind::session_test
