#pragma once

#include <unistd.h>

#include "drivers/fakecam/fake_camera.hpp"
#include "tests/test.hpp"

namespace bolo::fakecam::test {

// A new loopback address on each call. It contains the process id, so that tests can run in parallel.
inline std::string fresh_address() {
  static int last = 0;
  const int pid = getpid();
  return "127." + std::to_string(1 + (pid >> 8) % 254) + "." + std::to_string(pid & 255) + "." + std::to_string(++last);
}

// A value that differs between pixels and frames, as far as 16 bits allow.
inline std::uint16_t pixel_of(std::size_t frame, std::size_t pixel) {
  return static_cast<std::uint16_t>(pixel * 7 + frame * 3001 + 20000);
}

inline FrameProvider synthetic(Geometry geometry, std::size_t frames, double period_s = 0.005) {
  FrameProvider content;
  content.format = {geometry, PixelType::kUint16, {Unit::kCount, 1.0, 0.0}, period_s};
  content.planes.resize(frames * plane_bytes(geometry, PixelType::kUint16));
  std::vector<std::uint16_t> plane(geometry.pixels());
  for (std::size_t f = 0; f < frames; ++f) {
    content.frame_ids.push_back(100 + f);
    content.times_s.push_back(2.0 + static_cast<double>(f) * period_s);
    for (std::size_t p = 0; p < plane.size(); ++p) plane[p] = pixel_of(f, p);
    std::memcpy(content.planes.data() + f * plane.size() * 2, plane.data(), plane.size() * 2);
  }
  return content;
}

inline std::unique_ptr<FakeCamera> serve(FrameProvider provider, const FakeCameraOptions& options) {
  return *must(FakeCamera::start(options, std::move(provider)));
}

}  // namespace bolo::fakecam::test
