// Small captures as input for tests of programs.
#pragma once

#include "tests/capture/frame_values.hpp"

namespace bolo::tools::test {

using capture::testing::frame_values;

// A format of this size at 200 frames a second, in hundredths of a kelvin.
inline capture::CaptureInfo small_info(Geometry geometry) {
  return {.format = {.geometry = geometry, .scale = {Unit::kKelvin, 0.01, 0.0}, .frame_period_s = 0.005}};
}

// Writes a uint16 capture; close() completes it.
class SmallCapture {
 public:
  SmallCapture(const std::filesystem::path& file, const capture::CaptureInfo& info)
      : writer_(capture::CaptureWriter::create(file, info, {.replace = Replace::kExisting})),
        plane_(info.format.geometry.pixels()) {
    EXPECT_TRUE(writer_) << writer_.error().message;
  }

  // Appends a frame at t_s with value(i) in pixel i.
  template <typename Value>
  void append(double t_s, std::uint64_t id, Value value) {
    for (std::size_t i = 0; i < plane_.size(); ++i) plane_[i] = static_cast<std::uint16_t>(value(i));
    EXPECT_TRUE(writer_->append(t_s, id, plane_.data()));
  }
  void close() { EXPECT_TRUE(writer_->close()); }
  capture::CaptureWriter* operator->() { return &*writer_; }

 private:
  Result<capture::CaptureWriter> writer_;
  std::vector<std::uint16_t> plane_;
};

}  // namespace bolo::tools::test
