// The judgement of single frames: that it sees what is wrong, and excuses what is not.
#include "bolo/shm_layout.h"
#include "tests/test.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak::frame_judge_test {

constexpr Geometry kGeometry{4, 6};
constexpr std::size_t kFrames = 30;
constexpr int kWindow = 5;
using Plane = std::vector<std::uint16_t>;

Plane raw_plane(std::size_t k) {
  Plane plane(kGeometry.pixels());
  for (std::size_t p = 0; p < plane.size(); ++p) plane[p] = static_cast<std::uint16_t>(30'000 + 17 * k * p + k);
  return plane;
}

Truth truth() {
  Truth::Planes raw;
  Truth::Planes deblurred;
  for (std::size_t k = 0; k < kFrames; ++k) {
    raw.push_back(raw_plane(k));
    deblurred.emplace_back(kGeometry.pixels(), static_cast<std::uint16_t>(1000 + k));
  }
  return Truth(raw, deblurred);
}

// Differences of a frame from the one that is due.
struct Change {
  int offset = 0;
  std::uint32_t flags = 0;
  std::uint64_t missed = 0;
};

// A stream of right frames, to be spoiled.
class SoakFrameJudge : public testing::Test {
 protected:
  Grade show(Change change = {}) {
    raw_ = raw_plane(index_ % kFrames);
    for (std::uint16_t& value : raw_) value = static_cast<std::uint16_t>(value + change.offset);
    deblurred_.assign(kGeometry.pixels(),
                      static_cast<std::uint16_t>(1000 + static_cast<int>(index_ % kFrames) + change.offset));
    if (spoil_) spoil_();
    number_ += change.missed;
    const Grade grade = judge_.judge(
        {number_, change.missed, id_, camera_ns_, 0, publish_ns_, change.flags, raw_.data(), deblurred_.data()});
    step();
    return grade;
  }
  void step() {
    ++index_;
    ++number_;
    ++id_;
    camera_ns_ += 5'000'000;
    publish_ns_ += 5'000'000;
  }
  void lose_frames(std::size_t n) {  // by the camera or on the way
    index_ += n;
    id_ += n;
    camera_ns_ += static_cast<std::int64_t>(n) * 5'000'000;
    publish_ns_ += static_cast<std::int64_t>(n) * 5'000'000;
  }
  void settle() {
    for (int i = 0; i < 2 * kWindow; ++i) EXPECT_EQ(show(), Grade::kClean);
  }
  std::uint64_t broken(Invariant invariant) const { return findings_.tally(invariant).broken; }

  Truth truth_ = truth();
  Findings findings_;
  FrameJudge judge_{truth_, kWindow, findings_};
  std::function<void()> spoil_;
  Plane raw_;
  Plane deblurred_;
  std::size_t index_ = 0;
  std::uint64_t number_ = 0;
  std::uint64_t id_ = 100;
  std::int64_t camera_ns_ = 1'000'000'000;
  std::int64_t publish_ns_ = 1;
};

TEST_F(SoakFrameJudge, SeesASingleWrongPixelOfARawPlane) {
  settle();
  for (const std::size_t pixel : {std::size_t{0}, kGeometry.pixels() / 2, kGeometry.pixels() - 1}) {
    spoil_ = [&] { raw_[pixel] ^= 1U; };
    EXPECT_EQ(show(), Grade::kWrong) << pixel;
  }
  EXPECT_EQ(broken(Invariant::kRaw), 3U);
}

TEST_F(SoakFrameJudge, SeesASingleWrongPixelOfASharpPlaneUnlessItsFlagSaysSo) {
  settle();
  spoil_ = [&] { deblurred_[7] += 1; };
  EXPECT_EQ(show(), Grade::kWrong);
  EXPECT_EQ(show({.flags = BOLO_FLAG_GAP}), Grade::kFlagged);
  EXPECT_EQ(broken(Invariant::kDeblurred), 1U);
  lose_frames(1);
  EXPECT_EQ(show(), Grade::kWrong) << "after a lost frame, too";
  EXPECT_EQ(broken(Invariant::kOrder), 0U);
}

TEST_F(SoakFrameJudge, ExcusesAWindowAfterWhatCannotBeTold) {
  settle();
  ++id_;  // the camera's counter jumps, its scene and clock go on
  spoil_ = [&] { deblurred_[7] += 1; };
  for (int i = 0; i < kWindow; ++i) EXPECT_EQ(show(), Grade::kSettling);
  EXPECT_EQ(show(), Grade::kWrong);
}

TEST_F(SoakFrameJudge, FollowsAShuttersOffset) {
  judge_.allow(50);
  settle();
  for (int i = 0; i <= kWindow; ++i) show({.offset = 50});
  EXPECT_EQ(show({.offset = 50}), Grade::kClean);
  spoil_ = [&] { deblurred_[3] += 1; };  // rounding
  EXPECT_EQ(show({.offset = 50}), Grade::kClean);
  spoil_ = [&] { deblurred_[3] += 2; };
  EXPECT_EQ(show({.offset = 50}), Grade::kWrong);
  EXPECT_EQ(show({.offset = 51}), Grade::kWrong);
}

TEST_F(SoakFrameJudge, SeesAHoleInTheNumbers) {
  settle();
  ++number_;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 1U);
  show({.missed = 3});  // overwritten before they were read: known
  EXPECT_EQ(broken(Invariant::kOrder), 1U);
}

TEST_F(SoakFrameJudge, SeesIdsAndTimesThatDoNotRise) {
  settle();
  --id_;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 1U);
  publish_ns_ -= 5'000'000;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 2U);
  camera_ns_ -= 1'000'000'000;
  show({.flags = BOLO_FLAG_WARM_UP});  // a new window
  EXPECT_EQ(broken(Invariant::kOrder), 2U);
  camera_ns_ -= 1'000'000'000;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 3U);
}

}  // namespace bolo::tools::soak::frame_judge_test
