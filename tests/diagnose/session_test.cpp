// Sessions with something wrong: one clear line for each, and no verdict that blames the camera for it.
#include "src/diagnose/session.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "src/capture/capture.hpp"
#include "src/diagnose/diagnose.hpp"
#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::session_test {
namespace {

using testing::noisy_camera;
using testing::record;

bool go_on(const std::string&, double) { return true; }

class SessionFiles : public ::testing::Test {
 protected:
  std::filesystem::path shutter(const std::string& name, int frames = 40, std::uint64_t seed = 1) {
    testing::write(record(noisy_camera(seed), capture::Uniform{300.0}, frames), scratch_ / name);
    return scratch_ / name;
  }

  // Two good shutters and `bad`: it is left out with one line that says `why`, the others stay.
  void expect_left_out(const std::filesystem::path& bad, const std::vector<std::string>& why) {
    const auto session = read_session({shutter("good-1.h5"), bad, shutter("good-2.h5", 40, 2)}, go_on);
    ASSERT_TRUE(session) << session.error().message;
    EXPECT_EQ(session->recordings.size(), 2U);
    ASSERT_EQ(session->warnings.size(), 1U);
    const std::string& line = session->warnings[0];
    EXPECT_EQ(line.find('\n'), std::string::npos) << line;
    EXPECT_NE(line.find(bad.filename().string()), std::string::npos) << line;
    for (const std::string& word : why) EXPECT_NE(line.find(word), std::string::npos) << line << " lacks: " << word;
    // By itself it is no session.
    const auto alone = read_session({bad}, go_on);
    if (!alone) {
      EXPECT_EQ(alone.error().kind, ErrorKind::kBadInput);
    }
  }

  // A capture written by hand: `value(frame, pixel)` in counts, or kelvin for float32.
  template <typename T, typename Value>
  std::filesystem::path raw(const std::string& name, Geometry geometry, Value value, double period_s = 0.005) {
    capture::CaptureInfo info;
    info.format.geometry = geometry;
    info.format.type = std::is_same_v<T, float> ? PixelType::kFloat32 : PixelType::kUint16;
    info.format.scale = {Unit::kKelvin, std::is_same_v<T, float> ? 1.0 : 0.01, 0.0};
    info.format.frame_period_s = period_s;
    info.camera_model = "camera";
    auto writer = capture::CaptureWriter::create(scratch_ / name, info);
    EXPECT_TRUE(writer) << writer.error().message;
    EXPECT_TRUE(writer->write_stimulus(capture::Uniform{300.0}));
    std::vector<T> plane(geometry.pixels());
    for (std::uint64_t k = 0; k < 40; ++k) {
      for (std::size_t p = 0; p < plane.size(); ++p) plane[p] = value(k, p);
      EXPECT_TRUE(writer->append(static_cast<double>(k) * period_s, k, plane.data()));
    }
    EXPECT_TRUE(writer->close());
    return scratch_ / name;
  }

  Scratch scratch_;
};

TEST_F(SessionFiles, ReadsWhatIsThere) {
  const auto session = read_session({shutter("a.h5"), shutter("b.h5", 50)}, go_on);
  ASSERT_TRUE(session) << session.error().message;
  EXPECT_TRUE(session->warnings.empty());
  EXPECT_EQ(session->width, testing::kWidth);
  EXPECT_EQ(session->height, testing::kHeight);
  EXPECT_EQ(session->grid.pixels(), testing::kWidth * testing::kHeight);
  ASSERT_EQ(session->recordings.size(), 2U);
  EXPECT_EQ(session->recordings[0].kind, Kind::kUniform);
  EXPECT_EQ(session->recordings[1].frames(), 50);
  EXPECT_NEAR(session->recordings[0].step, 0.01, 1e-12);
  EXPECT_NEAR(static_cast<double>(session->recordings[0].values.mean()), 300.0, 0.01);
}

TEST_F(SessionFiles, AMissingFile) { expect_left_out(scratch_ / "gone.h5", {}); }

TEST_F(SessionFiles, AFileThatIsNoCapture) {
  std::ofstream(scratch_ / "notes.h5") << "no HDF5\n";
  expect_left_out(scratch_ / "notes.h5", {});
}

TEST_F(SessionFiles, TooFewFrames) { expect_left_out(shutter("short.h5", 9), {"9 frames", "16"}); }

TEST_F(SessionFiles, AnotherCamera) {
  testing::write(record(noisy_camera(), capture::Uniform{300.0}, 40), scratch_ / "other.h5", "other model");
  expect_left_out(scratch_ / "other.h5", {"other model", "camera"});
}

TEST_F(SessionFiles, AnotherSize) {
  const auto flat = [](std::uint64_t k, std::size_t p) { return static_cast<std::uint16_t>(30000 + (k * 7 + p) % 5); };
  expect_left_out(raw<std::uint16_t>("large.h5", {40, 24}, flat), {"40x24", "32x24"});
}

TEST_F(SessionFiles, AnotherFramePeriod) {
  const auto flat = [](std::uint64_t k, std::size_t p) { return static_cast<std::uint16_t>(30000 + (k * 7 + p) % 5); };
  expect_left_out(raw<std::uint16_t>("slow.h5", {32, 24}, flat, 0.02), {"frame period"});
}

TEST_F(SessionFiles, ASaturatedCapture) {
  const auto full = [](std::uint64_t, std::size_t) { return static_cast<std::uint16_t>(65535); };
  expect_left_out(raw<std::uint16_t>("full.h5", {32, 24}, full), {"limit"});
}

TEST_F(SessionFiles, ValuesThatAreNoNumbers) {
  const auto nan = [](std::uint64_t k, std::size_t p) { return k == 11 && p == 300 ? std::nanf("") : 300.0F; };
  expect_left_out(raw<float>("nan.h5", {32, 24}, nan), {"no numbers"});
}

TEST_F(SessionFiles, AStimulusThatCannotBe) {
  Recording bars = record(noisy_camera(), testing::slanted_bars(0.0), 40);
  auto& target = std::get<capture::BarTarget>(bars.stimulus);
  std::swap(target.hot_k, target.cold_k);
  testing::write(bars, scratch_ / "bars.h5");
  expect_left_out(scratch_ / "bars.h5", {"hot_k"});
}

TEST_F(SessionFiles, NoFilesAtAll) {
  const auto session = read_session({}, go_on);
  ASSERT_FALSE(session);
  EXPECT_EQ(session.error().kind, ErrorKind::kBadInput);
}

TEST_F(SessionFiles, TheDiagnosisCanBeStopped) {
  const auto report = diagnose({shutter("a.h5")}, {}, [](const std::string&, double) { return false; });
  EXPECT_FALSE(report);
}

TEST_F(SessionFiles, AnEffectToWithholdMustBeKnown) {
  Options options;
  options.withheld = {"tau_globl"};
  const auto report = diagnose({shutter("a.h5")}, options, go_on);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(report.error().message.find("tau_globl"), std::string::npos);
}

// The chopper of the file never ran: one warning, and the camera is not blamed.
TEST_F(SessionFiles, AStimulusThatDoesNotMatchItsCapture) {
  Recording wrong = record(noisy_camera(3), capture::Uniform{300.0}, 240);
  wrong.stimulus = testing::odd_chopper();
  testing::write(wrong, scratch_ / "chopper.h5");
  const auto report = diagnose({shutter("shutter.h5", 240), scratch_ / "chopper.h5"}, {}, go_on);
  ASSERT_TRUE(report) << report.error().message;
  ASSERT_EQ(report->warnings.size(), 1U);
  EXPECT_NE(report->warnings[0].find("chopper.h5"), std::string::npos);
  EXPECT_NE(report->warnings[0].find("/stimulus"), std::string::npos);
  EXPECT_EQ(report->verdict, "no_gap");
  EXPECT_TRUE(report->effects.empty()) << report->effects.front().name;
}

// A level that is off by a kelvin is the bench's error, not the camera's.
TEST_F(SessionFiles, ALevelThatIsOff) {
  sim::StimulusError error;
  error.level_k = 0.8;
  testing::write(record(noisy_camera(4), capture::Uniform{325.0}, 120, error), scratch_ / "flat.h5");
  const auto report = diagnose({shutter("shutter.h5", 120), scratch_ / "flat.h5"}, {}, go_on);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_TRUE(report->effects.empty()) << report->effects.front().name;
  EXPECT_NEAR(report->stimulus.at("flat.h5").at("level_error_k"), 0.8, 0.02);
}

}  // namespace
}  // namespace bolo::diagnose::session_test
