// Tests of the program `bolo deblur`, on captures of pixels with known thermal inertia.
#pragma once

#include <variant>

#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"

namespace bolo::tools::test {

namespace fs = std::filesystem;

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
  double period_s = kPeriod;  // of /t and frame_period_s; the blur always has kPeriod
  std::size_t reads = 1;      // repetitions of each frame
  struct {
    std::size_t frame;
    float value;
  } odd{~std::size_t{0}, 0.0F};  // value of pixel (1,1), for float captures
};

// A bar 12 K above 295 K that stays for 8 frames at each place, so that its edges are blurred.
inline double scene_k(std::size_t frame, int x, int y) {
  const int place = static_cast<int>(frame / 8) * 5;
  return (x + 2 * y + place) % 20 < 7 ? 307.0 : 295.0;
}

// Writes the exact response of pixels to a scene that is constant between frames.
inline void write_blurred(const std::filesystem::path& file, const Blurred& b) {
  capture::CaptureInfo info = small_info({b.width, b.height});
  info.format.type = b.type;
  info.format.scale = b.scale;
  const double read_period_s = b.period_s / static_cast<double>(b.reads);
  info.format.frame_period_s = read_period_s;
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
      const double x = scene_k(n, static_cast<int>(i) % b.width, static_cast<int>(i) / b.width);
      y[i] = decay * y[i] + (1.0 - decay) * x;
      truth[i] = static_cast<float>(x);
      values[i] = static_cast<float>(y[i]);
      counts[i] = static_cast<std::uint16_t>(std::lround((y[i] - b.scale.offset) / 0.01));
    }
    if (n == b.odd.frame) values[static_cast<std::size_t>(b.width) + 1] = b.odd.value;
    if (std::find(b.lost.begin(), b.lost.end(), n) != b.lost.end()) continue;
    const void* plane = b.type == PixelType::kUint16 ? static_cast<const void*>(counts.data()) : values.data();
    for (std::size_t read = n * b.reads; read < (n + 1) * b.reads; ++read) {
      ASSERT_TRUE(writer->append(100.0 + static_cast<double>(read) * read_period_s, 500 + read, plane,
                                 b.truth ? truth.data() : nullptr));
    }
  }
  for (const capture::Event& event : b.events) ASSERT_TRUE(writer->add_event(event));
  if (!std::holds_alternative<capture::NoStimulus>(b.stimulus)) {
    ASSERT_TRUE(writer->write_stimulus(b.stimulus));
  }
  (void)must(writer->close());
}

class DeblurVerb : public ProgramTest {
 protected:
  // Starts with the standard in.h5, which a test may replace.
  DeblurVerb() : ProgramTest({BOLO_PROGRAM, "deblur"}) { write_blurred(file("in.h5"), {}); }

  // Deblurs in.h5 with `more` options, expects success, and opens the output.
  capture::CaptureReader deblurred(const std::string& more = "", const std::string& name = "out.h5") {
    report_ = printed(words("@in.h5 -o @" + name + " --overwrite --json " + more));
    EXPECT_FALSE(fs::exists(file(name + ".part")));
    return *must(capture::CaptureReader::open(file(name)));
  }
  nlohmann::json report() const { return nlohmann::json::parse(report_); }
  double rmse(const char* which) const { return report()["rmse"][which].get<double>(); }

 private:
  std::string report_;
};

// Counts as floats.
inline std::vector<float> frame_of(const capture::CaptureReader& reader, std::size_t index) {
  if (reader.info().format.type == PixelType::kFloat32) return frame_values<float>(reader, index);
  const auto counts = frame_values(reader, index);
  return {counts.begin(), counts.end()};
}

inline void expect_same_frames(const capture::CaptureReader& one, const capture::CaptureReader& other) {
  ASSERT_EQ(one.frame_id(), other.frame_id());
  ASSERT_EQ(one.t(), other.t());
  for (std::size_t n = 0; n < one.info().frames; ++n) ASSERT_EQ(frame_of(one, n), frame_of(other, n)) << n;
}

// The pixels of `part` equal those of `whole` at these places bit by bit, including truth.
inline void expect_pixels_of(const capture::CaptureReader& whole, const std::vector<capture::Point>& places,
                             const capture::CaptureReader& part) {
  ASSERT_EQ(part.info().format.geometry.pixels(), places.size());
  ASSERT_EQ(part.info().frames, whole.info().frames);
  std::vector<float> truth(places.size());
  std::vector<float> whole_truth(whole.info().format.geometry.pixels());
  for (std::size_t n = 0; n < part.info().frames; ++n) {
    const auto few = frame_of(part, n);
    const auto all = frame_of(whole, n);
    ASSERT_TRUE(part.read_truth(n, truth.data()) && whole.read_truth(n, whole_truth.data()));
    for (std::size_t i = 0; i < places.size(); ++i) {
      const auto at = static_cast<std::size_t>(places[i].y * whole.info().format.geometry.width + places[i].x);
      ASSERT_EQ(few[i], all[at]) << "frame " << n << " pixel " << i;
      ASSERT_EQ(truth[i], whole_truth[at]);
    }
  }
}

template <typename T>
std::optional<T> attribute(const capture::CaptureReader& reader, const std::string& name) {
  const auto attributes = reader.attributes();
  EXPECT_TRUE(attributes);
  for (const capture::Attribute& a : attributes.value_or(std::vector<capture::Attribute>{})) {
    if (a.name == name && std::holds_alternative<T>(a.value)) return std::get<T>(a.value);
  }
  return std::nullopt;
}

}  // namespace bolo::tools::test
