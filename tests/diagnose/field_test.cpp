// What is said of recordings without a bench: simulated ones with and without a fault, and real ones.
#include "src/diagnose/field.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

#include "src/diagnose/diagnose.hpp"
#include "tests/diagnose/field_bed.hpp"
#include "tests/scratch.hpp"

namespace bolo::diagnose {
namespace {

using bed::Shot;

// Starts, stops and turns, up to 750 px/s.
sim::Path restless() {
  std::vector<sim::PathPoint> points;
  for (double t = -0.6; t < 5.0; t += 0.001) {
    points.push_back({t, 27.0 * std::sin(11.0 * t) + 17.0 * std::sin(23.0 * t + 1.0), 7.0 * std::sin(17.0 * t)});
  }
  return sim::Path(std::move(points));
}

Shot shot_of(Geometry view, sim::Path path) {
  Shot shot;
  shot.view = view;
  shot.frames = 220;
  shot.path = std::move(path);
  return shot;
}
Shot still() { return shot_of({64, 48}, sim::steady_pan(0.0)); }
Shot pan() { return shot_of({96, 72}, sim::steady_pan(240.0)); }
Shot hand() { return shot_of({96, 72}, restless()); }

class FieldRecording : public ::testing::Test {
 protected:
  Report diagnosed(const Shot& shot, const std::vector<std::string>& withheld = {}) {
    const auto file = scratch_ / ("shot-" + std::to_string(++shots_) + ".h5");
    EXPECT_EQ(bed::shoot(shot, file), "");
    Options options;
    options.withheld = withheld;
    auto report = diagnose({file}, options, [](const std::string&, double) { return true; });
    EXPECT_TRUE(report) << report.error().message;
    return report ? std::move(*report) : Report{};
  }

 private:
  Scratch scratch_;
  int shots_ = 0;
};

std::string effects_of(const Report& report) {
  std::string all;
  for (const FoundEffect& e : report.effects) all += (all.empty() ? "" : " ") + e.name;
  return all;
}

bool untold(const Report& report, const std::string& effect) {
  return std::ranges::find(report.not_identifiable, effect, &NotIdentifiable::effect) != report.not_identifiable.end();
}

TEST_F(FieldRecording, WithoutAnEffectThereIsNoGap) {
  for (const Shot& shot : {still(), hand()}) {
    const Report report = diagnosed(shot);
    EXPECT_EQ(report.verdict, "no_gap") << report.unexplained.where;
    EXPECT_EQ(effects_of(report), "");
    EXPECT_LT(report.gap_after, 1.1);
  }
}

// A scene that the camera sweeps over is followed all the same; before a still camera it is the only thing that moves.
TEST_F(FieldRecording, WhatMovesByItselfIsNoEffect) {
  for (Shot shot : {still(), hand()}) {
    const bool stands = shot.view.width == 64;
    shot.mover_px_s = 120.0;
    const Report report = diagnosed(shot);
    EXPECT_EQ(report.verdict, stands ? "not_testable" : "no_gap");
    EXPECT_EQ(report.needs.find("moves by itself") != std::string::npos, stands) << report.needs;
    EXPECT_EQ(effects_of(report), "");
  }
}

// What stillness cannot tell is listed, and what motion tells is not.
TEST_F(FieldRecording, SaysWhichEffectsItCannotTell) {
  const Report stood = diagnosed(still());
  EXPECT_TRUE(untold(stood, "fpn_offset"));
  EXPECT_TRUE(untold(stood, "tau_global"));
  EXPECT_FALSE(untold(stood, "flicker"));
  const Report moved = diagnosed(hand());
  EXPECT_FALSE(untold(moved, "fpn_offset"));
  EXPECT_FALSE(untold(moved, "fpn_gain"));
  EXPECT_TRUE(untold(moved, "clock_skew"));
}

struct Case {
  Shot shot;
  std::string effect;
};

TEST_F(FieldRecording, NamesTheEffectOrSaysThatSomethingIsLeft) {
  for (const Case& c :
       {Case{still(), "flicker"}, Case{still(), "stripes"}, Case{hand(), "fpn_offset"}, Case{pan(), "fpn_gain"}}) {
    Shot shot = c.shot;
    shot.effects = {c.effect};
    const Report named = diagnosed(shot);
    ASSERT_FALSE(named.effects.empty()) << c.effect;
    EXPECT_EQ(effects_of(named), c.effect);
    EXPECT_EQ(named.verdict, "explained");
    EXPECT_GT(named.gap_before, named.gap_after + 0.01) << c.effect;
    const Report withheld = diagnosed(shot, {c.effect});
    EXPECT_EQ(withheld.verdict, "unknown_effect") << c.effect;
    EXPECT_EQ(effects_of(withheld), "") << c.effect;
  }
}

TEST_F(FieldRecording, NamesTheFrameThatJumped) {
  for (Shot shot : {still(), hand()}) {
    shot.effects = {"offset_jump:jump_k=2,at_s=0.75"};
    const Report report = diagnosed(shot);
    EXPECT_EQ(effects_of(report), "offset_jump");
    ASSERT_EQ(report.observations.front().jumps.size(), 1U);
    EXPECT_EQ(report.observations.front().jumps[0].frame, 150U);
  }
}

// The second loss is one of two frames, and each is named by the frame after it.
TEST_F(FieldRecording, NamesTheFramesBeforeWhichOthersWereLost) {
  Shot shot = pan();
  shot.lost = {60, 120, 121};
  const Report report = diagnosed(shot);
  EXPECT_EQ(effects_of(report), "frame_loss");
  EXPECT_EQ(report.observations.front().lost_before, (std::vector<std::size_t>{60, 119}));
}

struct Real {
  const char* name;
  std::vector<std::string> wanted;
};

TEST_F(FieldRecording, OfRealCamerasItNamesWhatIsKnownOfThem) {
  const char* folder = std::getenv("BOLO_TEST_DATA");
  if (folder == nullptr) GTEST_SKIP() << "BOLO_TEST_DATA is not set";
  for (const Real& real : {Real{"atto320_blackbody_20C.h5", {"flicker", "stripes", "dead_pixels"}},
                           Real{"a65_drive_a.h5", {"fpn_offset"}}}) {
    const auto report = diagnose({std::filesystem::path(folder) / "captures" / real.name}, {},
                                 [](const std::string&, double) { return true; });
    ASSERT_TRUE(report) << report.error().message;
    for (const std::string& effect : real.wanted) {
      EXPECT_EQ(std::ranges::count(report->effects, effect, &FoundEffect::name), 1) << real.name << ' ' << effect;
    }
    EXPECT_GT(report->gap_before, report->gap_after) << real.name;
  }
}

}  // namespace
}  // namespace bolo::diagnose
