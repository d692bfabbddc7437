// Small captures in a scratch folder.
#pragma once

#include "tests/capture/frame_values.hpp"
#include "tests/scratch.hpp"

namespace bolo::capture::testing {

inline CaptureInfo small_info(PixelType type = PixelType::kUint16, Geometry geometry = {7, 3}) {
  return {.format = {geometry, type, {Unit::kKelvin, 0.01, 1.5}, 0.005, 4},
          .camera_model = "FLIR A655sc",
          .camera_serial = "55001234"};
}

// A value that is unique to frame and pixel and exact in every type.
inline std::uint16_t value_at(std::size_t frame, std::size_t pixel) {
  return static_cast<std::uint16_t>(1000 + 100 * frame + pixel);
}

template <typename T>
std::vector<T> plane_of(std::size_t frame, std::size_t pixels) {
  std::vector<T> plane(pixels);
  for (std::size_t i = 0; i < pixels; ++i) plane[i] = static_cast<T>(value_at(frame, i));
  return plane;
}

// The first `frames` frames of 7x3, one after the other.
inline std::vector<std::uint16_t> all_planes(std::size_t frames) {
  std::vector<std::uint16_t> values;
  for (std::size_t i = 0; i < frames; ++i)
    std::ranges::copy(plane_of<std::uint16_t>(i, 21), std::back_inserter(values));
  return values;
}

// Appends frame i at its nominal time, with truth if wanted.
inline Status append(CaptureWriter& writer, std::size_t i, bool truth = false) {
  const auto plane = plane_of<std::uint16_t>(i, 21);
  const auto truth_plane = plane_of<float>(i, 21);
  return writer.append(0.005 * static_cast<double>(i), i, plane.data(), truth ? truth_plane.data() : nullptr);
}

inline void write_small(const std::filesystem::path& file, std::size_t frames, const WriterOptions& how = {}) {
  auto writer = must(CaptureWriter::create(file, small_info(), how));
  for (std::size_t i = 0; i < frames; ++i) ASSERT_TRUE(append(*writer, i, how.truth));
  ASSERT_TRUE(writer->close());
}

inline void expect_frames(const CaptureReader& reader, std::size_t frames) {
  ASSERT_EQ(reader.info().frames, frames);
  for (std::size_t i = 0; i < frames; ++i) {
    ASSERT_EQ(frame_values(reader, i), plane_of<std::uint16_t>(i, 21)) << "frame " << i;
    ASSERT_EQ(reader.frame_id()[i], i);
  }
}

}  // namespace bolo::capture::testing
