// Captures of a few lines: what tests of programs read.
#pragma once

#include "src/capture/capture.hpp"
#include "tests/test.hpp"

namespace bolo::tools::test {

// 200 frames a second of this size, in hundredths of a kelvin.
inline capture::CaptureInfo small_info(Geometry geometry) {
  return {.format = {.geometry = geometry, .scale = {Unit::kKelvin, 0.01, 0.0}, .frame_period_s = 0.005}};
}

// A capture of uint16 that is being written; close() makes it whole.
class SmallCapture {
 public:
  SmallCapture(const std::filesystem::path& file, const capture::CaptureInfo& info)
      : writer_(capture::CaptureWriter::create(file, info, {.replace = Replace::kExisting})),
        plane_(info.format.geometry.pixels()) {
    EXPECT_TRUE(writer_) << writer_.error().message;
  }

  // A frame at t_s, whose pixel i is value(i).
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
