// Captures as a pixel of known inertia makes them, for tests of what deblurs them.
#pragma once

#include "tests/tools/small_capture.hpp"

namespace bolo::tools::test {

inline constexpr int kWidth = 40;
inline constexpr int kHeight = 6;
inline constexpr double kPeriod = 0.005;
inline constexpr double kTau = 0.011;

struct Blurred {
  PixelType type = PixelType::kUint16;
  LinearScale scale{Unit::kKelvin, 0.01, 0.0};
  bool truth = true;
  std::size_t frames = 60;
  std::vector<std::uint64_t> lost{};
  std::vector<capture::Event> events{};
  capture::Stimulus stimulus = capture::NoStimulus{};
  int width = kWidth;
  int height = kHeight;
  double period_s = kPeriod;  // that of /t and frame_period_s; the blur is always that of kPeriod
  struct {
    std::size_t frame;
    float value;
  } odd{~std::size_t{0}, 0.0F};  // of a single pixel (1,1), of floats
};

// A bar 12 K above 295 K that stands for 8 frames in each place, so that its edges are blurred.
inline double scene_k(std::size_t frame, int x, int y) {
  const int place = static_cast<int>(frame / 8) * 5;
  return (x + 2 * y + place) % 20 < 7 ? 307.0 : 295.0;
}

// The exact answer of a pixel to a scene that is constant between frames, written as a capture.
inline void write_blurred(const std::filesystem::path& file, const Blurred& b) {
  capture::CaptureInfo info = small_info({b.width, b.height});
  info.format.type = b.type;
  info.format.scale = b.scale;
  info.format.frame_period_s = b.period_s;
  info.camera_model = "a camera";
  auto writer = must(capture::CaptureWriter::create(file, info, {.truth = b.truth, .replace = Replace::kExisting}));
  const std::size_t pixels = info.format.geometry.pixels();
  const double decay = std::exp(-kPeriod / kTau);
  std::vector<double> y(pixels, 298.0);
  std::vector<float> truth(pixels);
  std::vector<std::uint16_t> counts(pixels);
  std::vector<float> values(pixels);
  for (std::size_t n = 0; n < b.frames; ++n) {
    for (std::size_t i = 0; i < pixels; ++i) {
      const auto column = static_cast<int>(i % static_cast<std::size_t>(b.width));
      const auto row = static_cast<int>(i / static_cast<std::size_t>(b.width));
      const double x = scene_k(n, column, row);
      y[i] = decay * y[i] + (1.0 - decay) * x;
      truth[i] = static_cast<float>(x);
      values[i] = static_cast<float>(y[i]);
      counts[i] = static_cast<std::uint16_t>(std::lround((y[i] - b.scale.offset) / 0.01));
    }
    if (n == b.odd.frame) values[static_cast<std::size_t>(b.width) + 1] = b.odd.value;
    if (std::find(b.lost.begin(), b.lost.end(), n) != b.lost.end()) continue;
    const void* plane = b.type == PixelType::kUint16 ? static_cast<const void*>(counts.data()) : values.data();
    ASSERT_TRUE(
        writer->append(100.0 + static_cast<double>(n) * b.period_s, 500 + n, plane, b.truth ? truth.data() : nullptr));
  }
  for (const capture::Event& event : b.events) ASSERT_TRUE(writer->add_event(event));
  if (!std::holds_alternative<capture::NoStimulus>(b.stimulus)) {
    ASSERT_TRUE(writer->write_stimulus(b.stimulus));
  }
  (void)must(writer->close());
}

}  // namespace bolo::tools::test
