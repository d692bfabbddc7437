// Faulty sessions: one clear line for each fault, and no verdict against the camera.
#include "src/diagnose/session.hpp"
#include "src/diagnose/calibrate.hpp"
#include "tests/diagnose/bench.hpp"
#include "tests/refusal.hpp"

namespace bolo::diagnose::session_test {

using testing::diagnosed;
using testing::go_on;
using testing::noisy_camera;
using testing::record;

class SessionFiles : public ::testing::Test {
 protected:
  std::filesystem::path shutter(const std::string& name, int frames = 40, std::uint64_t seed = 1) {
    return testing::write(record(noisy_camera(seed), capture::Uniform{300.0}, frames), scratch_ / name);
  }

  // Two good shutters and `bad`: it is excluded with one line that contains `why`.
  void expect_left_out(const std::filesystem::path& bad, const std::vector<std::string>& why) {
    SCOPED_TRACE(bad.filename());
    for (const auto& [name, seed] : {std::pair{"good-1.h5", 1U}, {"good-2.h5", 2U}}) {
      if (!std::filesystem::exists(scratch_ / name)) shutter(name, 40, seed);
    }
    const auto session = must(read_session({scratch_ / "good-1.h5", bad, scratch_ / "good-2.h5"}, go_on));
    EXPECT_EQ(session->recordings.size(), 2U);
    ASSERT_EQ(session->warnings.size(), 1U);
    const std::string& line = session->warnings[0];
    expect_none(line, {"\n"});
    expect_parts(line, {bad.filename().string()});
    for (const std::string& word : why) expect_parts(line, {word});
    // Alone it is no session.
    const auto alone = read_session({bad}, go_on);
    if (!alone) {
      EXPECT_EQ(alone.error().kind, ErrorKind::kBadInput);
    }
  }

  // A raw capture: `value(frame, pixel)` in counts, or kelvin for float.
  template <typename T, typename Value>
  std::filesystem::path raw(const std::string& name, Geometry geometry, Value value, double period_s = 0.005) {
    const auto fill = [&](int k, std::vector<T>& plane) {
      for (std::size_t p = 0; p < plane.size(); ++p) plane[p] = value(static_cast<std::size_t>(k), p);
    };
    return testing::write_capture<T>(scratch_ / name, geometry, 40, fill, capture::Uniform{300.0}, period_s);
  }

  static std::uint16_t flat(std::size_t k, std::size_t p) {
    return static_cast<std::uint16_t>(30000 + (k * 7 + p) % 5);
  }

  Scratch scratch_;
};

TEST_F(SessionFiles, ReadsWhatIsThere) {
  const auto session = must(read_session({shutter("a.h5"), shutter("b.h5", 50)}, go_on));
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

TEST_F(SessionFiles, WhatCannotBeReadOrComparedIsLeftOut) {
  expect_left_out(scratch_ / "gone.h5", {});
  std::ofstream(scratch_ / "notes.h5") << "no HDF5\n";
  expect_left_out(scratch_ / "notes.h5", {});
  expect_left_out(shutter("short.h5", 9), {"9 frames", "16"});
  const Recording other = record(noisy_camera(), capture::Uniform{300.0}, 40);
  expect_left_out(testing::write(other, scratch_ / "other.h5", "other model"), {"other model", "camera"});
  expect_left_out(raw<std::uint16_t>("large.h5", {40, 24}, flat), {"40x24", "32x24"});
  expect_left_out(raw<std::uint16_t>("slow.h5", {32, 24}, flat, 0.02), {"frame period"});
  const auto full = [](std::size_t, std::size_t) { return static_cast<std::uint16_t>(65535); };
  expect_left_out(raw<std::uint16_t>("full.h5", {32, 24}, full), {"limit"});
  const auto nan = [](std::size_t k, std::size_t p) { return k == 11 && p == 300 ? std::nanf("") : 300.0F; };
  expect_left_out(raw<float>("nan.h5", {32, 24}, nan), {"no numbers"});
}

TEST_F(SessionFiles, AStimulusThatCannotBe) {
  Recording bars = record(noisy_camera(), testing::slanted_bars(0.0), 40);
  auto& target = std::get<capture::BarTarget>(bars.stimulus);
  std::swap(target.hot_k, target.cold_k);
  expect_left_out(testing::write(bars, scratch_ / "bars.h5"), {"hot_k"});
}

TEST_F(SessionFiles, MapsOfAnotherSizeAreRefused) {
  model::PixelMaps known;
  known.offset.assign(6, 0.1F);
  expect_refused(read_session({shutter("a.h5")}, go_on, known), {"a.h5", "maps"});
}

TEST_F(SessionFiles, NoFilesAtAll) { expect_refused(read_session({}, go_on), {}); }

TEST_F(SessionFiles, TheDiagnosisCanBeStopped) {
  EXPECT_FALSE(diagnose({shutter("a.h5")}, {}, [](const std::string&, double) { return false; }));
}

// Long captures take seconds to read.
TEST_F(SessionFiles, ReadingCanBeStopped) {
  int asked = 0;
  const auto few_times = [&asked](const std::string&, double) { return ++asked < 10; };
  expect_error(read_session({shutter("a.h5")}, few_times), {"interrupted"});
  EXPECT_LT(asked, 20);

  const auto nothing = [](int, std::vector<float>& plane) { std::ranges::fill(plane, 300.0F); };
  const auto file = scratch_ / "chopper.h5";
  testing::write_capture<float>(file, {8, 4}, 40, nothing, capture::Chopper{300.0, {0.0}, {0.1}, {310.0}}, 0.005);
  std::string step;
  const auto first_step = [&step](const std::string& what, double) {
    if (step.empty()) step = what;
    return false;
  };
  expect_error(calibrate({file}, {}, first_step), {"interrupted"});
  EXPECT_EQ(step, "reading");
}

// Findings so far belong to the frames read before, which had another size or other times.
TEST_F(SessionFiles, ACaptureThatChangesMeanwhileIsSaid) {
  const auto pan = [this](const std::string& name, Geometry size, int frames) {
    const auto fill = [size](int k, std::vector<std::uint16_t>& plane) {
      for (std::size_t p = 0; p < plane.size(); ++p) {
        const double x = static_cast<double>(p % static_cast<std::size_t>(size.width)) + 1.5 * k;
        const double y = static_cast<double>(p / static_cast<std::size_t>(size.width));
        const double noise = static_cast<double>((p * 7919 + static_cast<std::size_t>(k) * 104729) % 13);
        plane[p] = static_cast<std::uint16_t>(30000.0 + 400.0 * std::sin(0.2 * x) * std::cos(0.3 * y) +
                                              300.0 * std::sin(0.07 * x + 0.11 * y) + noise);
      }
    };
    return testing::write_capture<std::uint16_t>(scratch_ / name, size, frames, fill);
  };
  for (const auto& [size, frames] : {std::pair{Geometry{160, 120}, 150}, {Geometry{96, 64}, 90}}) {
    const std::filesystem::path file = pan("pan.h5", {96, 64}, 150);
    const std::filesystem::path other = pan("other.h5", size, frames);
    const auto replace = [&](const std::string& step, double) {
      if (step == "following the scene" && std::filesystem::exists(other)) std::filesystem::rename(other, file);
      return true;
    };
    expect_error(diagnose({file}, {}, replace), {"pan.h5", "changed while it was diagnosed"});
    EXPECT_FALSE(std::filesystem::exists(other));
    std::filesystem::remove(file);
  }
}

TEST_F(SessionFiles, AnEffectToWithholdMustBeKnown) {
  expect_refused(diagnose({shutter("a.h5")}, {.withheld = {"tau_globl"}}, go_on), {"tau_globl"});
}

// The chopper described in the file never ran: one warning, and no effect of the camera.
TEST_F(SessionFiles, AStimulusThatDoesNotMatchItsCapture) {
  Recording wrong = record(noisy_camera(3), capture::Uniform{300.0}, 240);
  wrong.stimulus = testing::odd_chopper();
  const Report report = diagnosed({shutter("shutter.h5", 240), testing::write(wrong, scratch_ / "chopper.h5")});
  ASSERT_EQ(report.warnings.size(), 1U);
  expect_parts(report.warnings[0], {"chopper.h5", "/stimulus"});
  EXPECT_EQ(testing::told(report), "no_gap:");
}

// A level error of 1 K is the bench's, not the camera's.
TEST_F(SessionFiles, ALevelThatIsOff) {
  sim::StimulusError error;
  error.level_k = 0.8;
  const Recording off = record(noisy_camera(4), capture::Uniform{325.0}, 120, error);
  const Report report = diagnosed({shutter("shutter.h5", 120), testing::write(off, scratch_ / "flat.h5")});
  EXPECT_TRUE(report.effects.empty()) << testing::told(report);
  EXPECT_NEAR(report.stimulus.at("flat.h5").at("level_error_k"), 0.8, 0.02);
}

// Not one beyond its last: the first column is 1 K colder.
TEST(DrawnPixel, OfAFrameOfOneRowIsItsMiddleOne) {
  const Scratch scratch;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(30000.0, 3.0);
  const auto fill = [&](int, std::vector<std::uint16_t>& counts) {
    for (std::uint16_t& count : counts) count = static_cast<std::uint16_t>(noise(random));
    counts[0] = static_cast<std::uint16_t>(counts[0] - 100);
  };
  const capture::Uniform flat{300.0};
  const Report report = diagnosed({testing::write_capture<std::uint16_t>(scratch / "row.h5", {16, 1}, 40, fill, flat)});
  ASSERT_EQ(report.captures.size(), 1U);
  int drawn = 0;
  for (const plot::Plot& plot : report.captures.front().plots) {
    for (const plot::Series& series : plot.series) {
      if (series.label != "camera") continue;
      ++drawn;
      for (const double kelvin : series.y) EXPECT_NEAR(kelvin, 300.0, 0.3);
    }
  }
  EXPECT_EQ(drawn, 1);
}

}  // namespace bolo::diagnose::session_test
