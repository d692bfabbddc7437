// Diagnoses of simulated recordings without a bench, with and without a fault.
#include "src/diagnose/field.hpp"
#include "src/capture/pixel_maps_io.hpp"
#include "src/diagnose/field_parts.hpp"
#include "tests/diagnose/field_bed.hpp"

namespace bolo::diagnose::field_test {

using bed::Shot;
using testing::told;

Shot still() { return {.view = {64, 48}, .frames = 220, .path = sim::steady_pan(0.0)}; }
Shot pan() { return {.view = {96, 72}, .frames = 220, .path = sim::steady_pan(240.0)}; }
Shot hand() { return {.view = {96, 72}, .frames = 220, .path = bed::restless()}; }

class FieldRecording : public ::testing::Test {
 protected:
  Report diagnosed(const Shot& shot, const std::vector<std::string>& withheld = {}, bool maps = false,
                   const std::filesystem::path& known = {}) {
    const auto file = scratch_ / ("shot-" + std::to_string(++shots_) + ".h5");
    Options options;
    options.withheld = withheld;
    options.maps = maps;
    options.profile.maps = known;
    return testing::diagnosed({bed::shoot(shot, file)}, options);
  }

  Scratch scratch_;

 private:
  int shots_ = 0;
};

bool untold(const Report& report, const std::string& effect) {
  return std::ranges::find(report.not_identifiable, effect, &NotIdentifiable::effect) != report.not_identifiable.end();
}

// Effects that a still recording cannot identify are listed, those from motion are not.
TEST_F(FieldRecording, WithoutAnEffectThereIsNoGapAndItSaysWhatItCannotTell) {
  for (const bool moves : {false, true}) {
    const Report report = diagnosed(moves ? hand() : still());
    EXPECT_EQ(told(report), "no_gap:") << report.unexplained.where;
    EXPECT_LT(report.gap.after, 1.1);
    EXPECT_EQ(untold(report, "fpn_offset"), !moves);
    EXPECT_FALSE(untold(report, moves ? "fpn_gain" : "flicker"));
    EXPECT_TRUE(untold(report, moves ? "clock_skew" : "tau_global"));
  }
}

// A panned scene is tracked despite the object; before a still camera the object is the only motion.
TEST_F(FieldRecording, WhatMovesByItselfIsNoEffect) {
  for (Shot shot : {still(), hand()}) {
    const bool stands = shot.view.width == 64;
    shot.mover_px_s = 120.0;
    const Report report = diagnosed(shot);
    EXPECT_EQ(told(report), stands ? "not_testable:" : "no_gap:");
    EXPECT_EQ(report.needs.find("moves by itself") != std::string::npos, stands) << report.needs;
  }
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
    EXPECT_EQ(told(named), "explained: " + c.effect);
    EXPECT_GT(named.gap.before, named.gap.after + 0.01) << c.effect;
    EXPECT_EQ(told(diagnosed(shot, {c.effect})), "unknown_effect:") << c.effect;
  }
}

// A third of the noise, as much as slow pixel noise may be for a while, but far beyond its error in a large picture.
TEST_F(FieldRecording, NamesAFaintPatternOfManyPixels) {
  const Shot shot{.view = {320, 240}, .path = pan().path, .effects = {"fpn_offset:pixel_k=0.011,column_k=0"}};
  EXPECT_EQ(told(diagnosed(shot)), "explained: fpn_offset");
}

// Chance makes the offsets of few columns uneven; both halves of the data show the same ones.
TEST_F(FieldRecording, NamesAPatternOfFewColumns) {
  for (const int width : {48, 64, 80}) {
    const Shot shot{
        .view = {width, 48}, .frames = 220, .path = bed::restless(), .effects = {"fpn_offset:pixel_k=0,column_k=0.06"}};
    EXPECT_EQ(told(diagnosed(shot)), "explained: fpn_offset") << width;
  }
}

// As flat fields would show, which the recording lacks.
TEST_F(FieldRecording, LearnsMapsThatUndoThePattern) {
  for (const Case& c : {Case{hand(), "fpn_offset"}, Case{pan(), "fpn_gain"}}) {
    Shot shot = c.shot;
    shot.view = {160, 120};
    shot.frames = 500;
    shot.effects = {c.effect};
    const model::PixelMaps maps = diagnosed(shot, {}, true).learned.maps;
    EXPECT_EQ(maps.gain.empty(), c.effect == "fpn_offset");
    constexpr double kScene = 295.0;  // K, about the mean
    const double before = testing::unevenness(bed::camera_of(shot), {}, kScene);
    EXPECT_LT(testing::unevenness(bed::camera_of(shot), maps, kScene), 0.75 * before) << c.effect;
  }
}

// Effects that the profile's maps correct are not named again, others are; new maps are for uncorrected frames.
TEST_F(FieldRecording, AppliesKnownMapsBefore) {
  Shot shot = hand();
  shot.view = {128, 96};
  shot.frames = 400;
  shot.effects = {"fpn_offset"};
  model::PixelMaps maps = diagnosed(shot, {}, true).learned.maps;
  constexpr double kScene = 295.0;  // K
  const double before = testing::unevenness(bed::camera_of(shot), {}, kScene);
  shot.effects.push_back("dead_pixels:form=stuck");
  const std::vector<float> cold = testing::flat_frame(bed::camera_of(shot), kScene);
  const std::vector<float> warm = testing::flat_frame(bed::camera_of(shot), kScene + 5.0);
  for (std::size_t p = 0; p < cold.size(); ++p) maps.dead.push_back(cold[p] == warm[p] ? 1 : 0);
  ASSERT_GT(std::ranges::count(maps.dead, 1), 20);
  for (const float share : {1.0F, 0.2F}) {
    model::PixelMaps known = maps;
    for (float& offset : known.offset) offset *= share;
    const auto file = scratch_ / "known-maps.h5";
    must(capture::write_pixel_maps({file, Replace::kExisting}, known));
    const Report report = diagnosed(shot, {}, true, file);
    EXPECT_EQ(told(report), share == 1.0F ? "no_gap:" : "explained: fpn_offset");
    EXPECT_LT(testing::unevenness(bed::camera_of(shot), report.learned.maps, kScene), 0.75 * before) << share;
    EXPECT_EQ(report.learned.maps.dead, maps.dead);
  }
}

TEST_F(FieldRecording, NamesTheFrameThatJumped) {
  for (Shot shot : {still(), hand()}) {
    // Far below the scene's changes at each pixel.
    shot.effects = {"offset_jump:jump_k=-0.4,at_s=0.75"};
    const Report report = diagnosed(shot);
    EXPECT_EQ(told(report), "explained: offset_jump");
    ASSERT_EQ(report.observations.front().jumps.size(), 1U);
    EXPECT_EQ(report.observations.front().jumps[0].frame, 150U);
    EXPECT_NEAR(report.effects.front().parameters.at("jump_k").value, -0.4, 0.02);
  }
}

// Unless an offset is a candidate before tracking, it misleads the match of its frame.
TEST_F(FieldRecording, NamesALargeJumpOfAMovingScene) {
  Shot shot{.view = {128, 96}, .frames = 200, .path = bed::slow_hand(), .period_s = 1.0 / 30.0};
  for (const auto& [jump_k, at_s] : {std::pair{1.35, 1.505}, std::pair{-1.15, 2.616}, std::pair{-0.75, 4.838}}) {
    shot.effects = {"offset_jump:jump_k=" + std::to_string(jump_k) + ",at_s=" + std::to_string(at_s)};
    const Report report = diagnosed(shot);
    EXPECT_EQ(told(report), "explained: offset_jump") << jump_k;
    ASSERT_EQ(report.observations.front().jumps.size(), 1U);
    EXPECT_NEAR(report.observations.front().jumps[0].size, jump_k, 0.05);
  }
}

TEST_F(FieldRecording, AHandTooFastToFollowHasNoJumps) {
  const Shot shot{.view = {96, 72}, .frames = 150, .path = bed::fast_hand(), .period_s = 1.0 / 30.0, .sky = true};
  EXPECT_EQ(diagnosed(shot).observations.front().jumps.size(), 0U);
}

// At a jerk of the hand, all pixels of an uneven sky change alike, but over some frames, unlike an offset.
TEST_F(FieldRecording, AJerkOverAnUnevenSkyIsNoJump) {
  for (const bool jumps : {false, true}) {
    Shot shot{.view = {96, 72}, .frames = 220, .path = bed::jerks(), .sky = true};
    if (jumps) shot.effects = {"offset_jump:jump_k=0.4,at_s=0.75"};
    const Report report = diagnosed(shot);
    EXPECT_EQ(report.effects.size(), jumps ? 1U : 0U) << told(report);
    std::vector<std::size_t> seen;
    for (const Observation::Jump& jump : report.observations.front().jumps) seen.push_back(jump.frame);
    EXPECT_EQ(seen, jumps ? std::vector<std::size_t>{150} : std::vector<std::size_t>());
  }
}

// A scene at rest except for some jerks is at the same pixels in both halves of the data.
TEST_F(FieldRecording, AJerkTellsNoPattern) {
  for (Shot shot : {Shot{.view = {96, 72}, .period_s = 1.0 / 30.0}, Shot{.view = {128, 96}, .period_s = 1.0 / 60.0},
                    Shot{.view = {128, 96}, .sky = true}}) {
    shot.frames = static_cast<int>(1.5 / shot.period_s);
    shot.path = bed::jerks();
    const Report report = diagnosed(shot);
    EXPECT_TRUE(report.effects.empty()) << told(report);
    EXPECT_TRUE(untold(report, "fpn_offset"));
  }
}

// The pattern from one jerk does not predict the others: it belongs to the scene.
TEST_F(FieldRecording, ManyJerksTellNoPattern) {
  constexpr double kPeriod = 1.0 / 30.0;
  const Report report = diagnosed({.view = {160, 120},
                                   .frames = 400,
                                   .path = bed::many_jerks(400 * kPeriod + 0.5),
                                   .period_s = kPeriod,
                                   .sky = true});
  EXPECT_TRUE(report.effects.empty()) << told(report);
}

// The scene jumps within a frame, and is then another picture.
TEST_F(FieldRecording, AJerkThatIsNotFollowedIsNoJump) {
  for (const bool sky : {false, true}) {
    const Report report =
        diagnosed({.view = {64, 48}, .frames = 60, .path = bed::jerks(0.001), .period_s = 1.0 / 30.0, .sky = sky});
    EXPECT_TRUE(report.effects.empty()) << told(report);
  }
}

// Offsets of pixels that grow with the package's temperature are no fixed pattern, even if observable only for a part
// of the time.
TEST_F(FieldRecording, NamesAPatternThatGrowsADrift) {
  for (const double from_s : {-10.0, 0.8}) {
    Shot shot = hand();
    shot.frames = from_s > 0.0 ? 320 : 220;
    shot.path = bed::restless(from_s);
    shot.effects = {"drift:amplitude_k=0.4,time_s=2,spread=0.5"};
    const Report report = diagnosed(shot);
    EXPECT_EQ(told(report), "explained: drift");
    EXPECT_FALSE(untold(report, "drift"));
  }
}

// Offsets after a NUC belong to it: no fixed pattern of the camera.
TEST_F(FieldRecording, NamesTheShutterAlone) {
  for (const char* when : {"1.2", "0.5"}) {
    Shot shot = hand();
    shot.frames = 400;
    shot.effects = {"nuc_freeze:freeze_frames=40,offset_k=0.08,at_s=" + std::string(when)};
    EXPECT_EQ(told(diagnosed(shot)), "explained: nuc_freeze") << when;
  }
}

// The second loss is of two frames; each is reported by the frame after it.
TEST_F(FieldRecording, NamesTheFramesBeforeWhichOthersWereLost) {
  for (const double px_s : {240.0, 100.0}) {
    Shot shot = pan();
    shot.path = sim::steady_pan(px_s);
    shot.lost = {60, 120, 121};
    const Report report = diagnosed(shot);
    EXPECT_EQ(told(report), "explained: frame_loss");
    EXPECT_EQ(report.observations.front().lost_before, (std::vector<std::size_t>{60, 119})) << px_s;
  }
}

// Also with too many frames for memory.
TEST_F(FieldRecording, FollowsTheWholeOfALargeRecording) {
  Shot shot = pan();
  shot.view = {640, 240};
  shot.frames = 360;
  shot.lost = {340};
  const Report report = diagnosed(shot);
  EXPECT_EQ(told(report), "explained: frame_loss");
  EXPECT_EQ(report.observations.front().lost_before, (std::vector<std::size_t>{340}));
}

// Where a prediction is wrong a pixel that changes as its neighbours do is not dead.
TEST(FieldDead, APixelThatIsBadlyPredictedFollowsItsNeighbours) {
  constexpr Geometry kView{16, 16};
  constexpr Index kDead = 5 * 16 + 5;
  constexpr Index kBadlyPredicted = 10 * 16 + 10;
  constexpr Index kFrames = 64;
  FieldFrames frames{kView, Series::Zero(kFrames, 256)};
  Residual residual{kView, Series::Zero(kFrames, 256), Series::Zero(kFrames, 4), {}};
  residual.valid.setOnes(kFrames, 4);
  std::vector<Triplet> triplets;
  for (Index k = 0; k < kFrames; ++k) {
    const auto scene = static_cast<float>(300.0 + 2.0 * std::sin(1.3 * static_cast<double>(k)));
    const auto another = static_cast<float>(300.0 + 2.0 * std::cos(1.3 * static_cast<double>(k)));
    frames.values.row(k).setConstant(scene);
    frames.values(k, kDead) = 300.0F;
    residual.values(k, kDead) = 300.0F - scene;
    residual.values(k, kBadlyPredicted) = scene - another;
    triplets.push_back({.frame = k});
  }
  const Cells cells{residual, Blocks(kView), Series::Ones(kFrames, 4), Series::Zero(kFrames, 4)};
  Mask dead(256, 0);
  find_unresponsive(cells, frames, triplets, 0.03, dead);
  EXPECT_EQ(std::ranges::count(dead, 1), 1);
  EXPECT_EQ(dead[kDead], 1);
}

}  // namespace bolo::diagnose::field_test
