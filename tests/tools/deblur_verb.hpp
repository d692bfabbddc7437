// `bolo deblur` as its user meets it, for its tests.
#pragma once

#include <variant>

#include <nlohmann/json.hpp>

#include "tests/tools/blurred_capture.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {

namespace fs = std::filesystem;

class DeblurVerb : public ProgramTest {
 protected:
  DeblurVerb() : ProgramTest({BOLO_PROGRAM, "deblur"}) {}

  // Runs on in.h5 with `more` options, expects success, and opens the output.
  capture::CaptureReader deblurred(const std::string& more = "", const std::string& name = "out.h5") {
    report_ = printed(words("@in.h5 -o @" + name + " --overwrite --json " + more));
    EXPECT_FALSE(fs::exists(file(name + ".part")));
    return *must(capture::CaptureReader::open(file(name)));
  }
  // The last run's report, and an error in it.
  nlohmann::json report() const { return nlohmann::json::parse(report_); }
  double rmse(const char* which) const { return report()["rmse"][which].get<double>(); }

 private:
  std::string report_;
};

inline std::vector<float> frame_of(const capture::CaptureReader& reader, std::size_t index) {
  const std::size_t pixels = reader.info().format.geometry.pixels();
  std::vector<float> values(pixels);
  if (reader.info().format.type == PixelType::kFloat32) {
    EXPECT_TRUE(reader.read_frame(index, values.data()));
    return values;
  }
  std::vector<std::uint16_t> counts(pixels);
  EXPECT_TRUE(reader.read_frame(index, counts.data()));
  for (std::size_t i = 0; i < pixels; ++i) values[i] = static_cast<float>(counts[i]);
  return values;
}

inline void expect_same_frames(const capture::CaptureReader& one, const capture::CaptureReader& other) {
  ASSERT_EQ(one.frame_id(), other.frame_id());
  ASSERT_EQ(one.t(), other.t());
  for (std::size_t n = 0; n < one.info().frames; ++n) ASSERT_EQ(frame_of(one, n), frame_of(other, n)) << n;
}

// The pixels of `part` are those of `whole` at these places, truth included, bit for bit.
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
