// What is written comes back, value for value.
#include <gtest/gtest.h>

#include <tuple>

#include "tests/capture/small_captures.hpp"

namespace bolo::capture {
namespace {

using testing::plane_of;
using testing::small_info;

constexpr std::size_t kFrames = 5;

using Variant = std::tuple<PixelType, bool, int>;  // type, truth, deflate level

class CaptureRoundTrip : public ::testing::TestWithParam<Variant> {};

template <typename T>
void append_frame(CaptureWriter& writer, std::size_t i, bool truth) {
  const auto plane = plane_of<T>(i, 21);
  const auto truth_plane = plane_of<float>(i + 50, 21);
  const Status good =
      writer.append(0.005 * static_cast<double>(i), 10 + 2 * i, plane.data(), truth ? truth_plane.data() : nullptr);
  ASSERT_TRUE(good) << good.error().message;
}

template <typename T>
void expect_frames(const CaptureReader& reader) {
  std::vector<T> plane(21);
  for (const std::size_t i : {4U, 0U, 2U, 1U, 3U}) {  // any order
    ASSERT_TRUE(reader.read_frame(i, plane.data()));
    EXPECT_EQ(plane, plane_of<T>(i, 21)) << "frame " << i;
  }
}

TEST_P(CaptureRoundTrip, EveryValueComesBack) {
  const auto [type, truth, level] = GetParam();
  const Scratch scratch;
  const auto file = scratch / "a.h5";
  auto writer = CaptureWriter::create(file, small_info(type), {truth, level});
  ASSERT_TRUE(writer) << writer.error().message;
  for (std::size_t i = 0; i < kFrames; ++i) {
    type == PixelType::kUint16 ? append_frame<std::uint16_t>(*writer, i, truth)
                               : append_frame<float>(*writer, i, truth);
  }
  const Status closed = writer->close();
  ASSERT_TRUE(closed) << closed.error().message;

  const auto reader = CaptureReader::open(file);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->info().format, small_info(type).format);
  EXPECT_EQ(reader->info().camera_model, "FLIR A655sc");
  EXPECT_EQ(reader->info().camera_serial, "55001234");
  EXPECT_EQ(reader->info().frames, kFrames);
  EXPECT_EQ(reader->info().has_truth, truth);
  EXPECT_EQ(reader->t(), (std::vector<double>{0.0, 0.005, 0.01, 0.015, 0.02}));
  EXPECT_EQ(reader->frame_id(), (std::vector<std::uint64_t>{10, 12, 14, 16, 18}));
  EXPECT_TRUE(reader->warnings().empty());
  type == PixelType::kUint16 ? expect_frames<std::uint16_t>(*reader) : expect_frames<float>(*reader);
  std::vector<float> plane(21);
  EXPECT_EQ(reader->read_truth(3, plane.data()).has_value(), truth);
  if (truth) {
    EXPECT_EQ(plane, plane_of<float>(53, 21));
  }
}

INSTANTIATE_TEST_SUITE_P(Variants, CaptureRoundTrip,
                         ::testing::Combine(::testing::Values(PixelType::kUint16, PixelType::kFloat32),
                                            ::testing::Bool(), ::testing::Values(0, 4)));

}  // namespace
}  // namespace bolo::capture
