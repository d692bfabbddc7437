#include "tools/lab/blind/session.hpp"

#include <gtest/gtest.h>

#include "src/capture/capture.hpp"
#include "tests/scratch.hpp"

namespace bolo::tools::blind::captures_test {
namespace {

using capture::CaptureReader;

Session short_session(Kind kind, const std::string& only, bool imperfect = false) {
  DrawOptions options;
  options.geometry = {16, 12};
  options.frames_scale = 0.15;
  options.only = only;
  options.imperfect = imperfect;
  return draw_session(options, kind, 0).value();
}

std::vector<std::uint16_t> frame(const CaptureReader& reader, std::size_t index) {
  std::vector<std::uint16_t> plane(reader.info().format.geometry.pixels());
  EXPECT_TRUE(reader.read_frame(index, plane.data()));
  return plane;
}

TEST(BlindCaptures, SayNothingOfWhatIsHidden) {
  const Scratch folder;
  const Session session = short_session(Kind::kSingle, "row_delay", true);
  const auto files = write_captures(session, folder.path());
  ASSERT_TRUE(files) << files.error().message;
  ASSERT_EQ(files->size(), 6U);
  for (std::size_t i = 0; i < files->size(); ++i) {
    const auto reader = CaptureReader::open((*files)[i]);
    ASSERT_TRUE(reader) << reader.error().message;
    EXPECT_TRUE(reader->attributes()->empty());
    EXPECT_TRUE(reader->events().empty());
    EXPECT_TRUE(reader->info().camera_serial.empty());
    EXPECT_FALSE(reader->info().has_truth);
    EXPECT_EQ(reader->info().frames, session.captures[i].frames);
    EXPECT_EQ(reader->frame_id().back(), session.captures[i].frames - 1);
    EXPECT_EQ(reader->info().format.scale.scale, 0.01);
  }
  const auto chopper = CaptureReader::open((*files)[2])->stimulus();
  ASSERT_TRUE(chopper);
  EXPECT_EQ(std::get<capture::Chopper>(*chopper).cold_k, 295.0);  // nominal, not as it really was
}

TEST(BlindCaptures, AreTheSameEachTime) {
  const Scratch first;
  const Scratch second;
  const Session session = short_session(Kind::kPair, "");
  const auto a = write_captures(session, first.path());
  const auto b = write_captures(session, second.path());
  ASSERT_TRUE(a && b);
  for (std::size_t i = 0; i < a->size(); ++i) {
    const auto left = CaptureReader::open((*a)[i]);
    const auto right = CaptureReader::open((*b)[i]);
    ASSERT_TRUE(left && right);
    EXPECT_EQ(frame(*left, 7), frame(*right, 7));
  }
}

TEST(BlindCaptures, TheStimulusStartsWhereItWasDrawn) {
  const Scratch folder;
  Session session = short_session(Kind::kEffectFree, "");
  session.captures = {session.captures[5]};  // the target that stands still
  session.captures[0].faults.phase = 0.0;
  ASSERT_TRUE(write_captures(session, folder.path()));
  const auto at_zero = frame(*CaptureReader::open(folder / session.captures[0].file), 5);
  std::filesystem::remove(folder / session.captures[0].file);
  session.captures[0].faults.phase = 3.0 / 20.0;  // of a period of 20 pixels
  ASSERT_TRUE(write_captures(session, folder.path()));
  const auto moved = frame(*CaptureReader::open(folder / session.captures[0].file), 5);
  for (std::size_t x = 3; x < 16; ++x) EXPECT_NEAR(moved[x], at_zero[x - 3], 40.0) << x;  // 0.4 K of noise
  EXPECT_GT(std::abs(moved[1] - at_zero[1]), 1000);
}

}  // namespace
}  // namespace bolo::tools::blind::captures_test
