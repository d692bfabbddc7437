// Observations on captures without a model, simulated and real, and on every pixel of a large frame.
#include "src/diagnose/stages.hpp"

#include <nlohmann/json.hpp>

#include "src/diagnose/report.hpp"
#include "tests/capture/frame_values.hpp"
#include "tests/diagnose/field_bed.hpp"
#include "tests/refusal.hpp"

namespace bolo::diagnose::observations_test {

using testing::diagnosed;
using testing::has;
using testing::told;

using Frame = std::vector<std::uint16_t>;

class Observations : public ::testing::Test {
 protected:
  template <typename Fill>
  std::filesystem::path write(const std::string& name, Geometry geometry, int frames, Fill fill,
                              const capture::Stimulus& stimulus = capture::NoStimulus{}) {
    return testing::write_capture<std::uint16_t>(scratch_ / name, geometry, frames, fill, stimulus);
  }

  // A real capture; empty where there is no test data.
  static std::filesystem::path real(const std::string& name) {
    const char* folder = std::getenv("BOLO_TEST_DATA");
    return folder == nullptr ? std::filesystem::path() : std::filesystem::path(folder) / "captures" / name;
  }

  // The same with `change(k)` counts added to every pixel of frame k.
  template <typename Change>
  std::filesystem::path altered(const std::string& name, Change change) {
    if (real(name).empty()) return {};
    auto reader = must(capture::CaptureReader::open(real(name)));
    auto writer = must(capture::CaptureWriter::create(scratch_ / name, reader->info()));
    for (std::size_t k = 0; k < reader->info().frames; ++k) {
      Frame plane = capture::testing::frame_values(*reader, k);
      for (std::uint16_t& count : plane) count = static_cast<std::uint16_t>(count + change(k));
      EXPECT_TRUE(writer->append(reader->t()[k], reader->frame_id()[k], plane.data()));
    }
    EXPECT_TRUE(writer->close());
    return scratch_ / name;
  }

  // A part of each frame from column `left` and row `top` on, or the same transposed.
  std::filesystem::path part_of(const std::string& name, int left, int top, Geometry part, bool transposed) {
    auto reader = must(capture::CaptureReader::open(real(name)));
    auto info = reader->info();
    const int across = info.format.geometry.width;
    info.format.geometry = transposed ? Geometry{part.height, part.width} : part;
    auto writer = must(capture::CaptureWriter::create(scratch_ / name, info));
    for (std::size_t k = 0; k < info.frames; ++k) {
      const Frame whole = capture::testing::frame_values(*reader, k);
      Frame plane;
      for (int y = 0; y < info.format.geometry.height; ++y) {
        for (int x = 0; x < info.format.geometry.width; ++x) {
          const int row = top + (transposed ? x : y);
          plane.push_back(whole[static_cast<std::size_t>(row * across + left + (transposed ? y : x))]);
        }
      }
      EXPECT_TRUE(writer->append(reader->t()[k], reader->frame_id()[k], plane.data()));
    }
    EXPECT_TRUE(writer->close());
    return scratch_ / name;
  }

  int noise(double counts = 3.0) { return static_cast<int>(std::lround(counts * unit_(engine_))); }
  void flat(int, Frame& plane) {
    for (std::uint16_t& count : plane) count = static_cast<std::uint16_t>(30000 + noise());
  }

  Scratch scratch_;

 private:
  std::mt19937 engine_{7};
  std::normal_distribution<double> unit_;
};

const Observation& only(const Report& report) {
  EXPECT_EQ(report.observations.size(), 1U);
  static const Observation kNone;
  return report.observations.empty() ? kNone : report.observations.front();
}

void expect_said(const Report& report, const std::string& text) {
  for (const std::string& form : {report_summary(report), report_html(report)}) expect_parts(form, {text});
}

TEST_F(Observations, AStreetWithAJumpOfFiveKelvinShowsTheJump) {
  constexpr int kJumpAt = 70;
  const Report report = diagnosed({bed::shoot(
      {.view = {96, 64}, .frames = 120, .path = sim::steady_pan(200.0), .effects = {"offset_jump:jump_k=5,at_s=0.35"}},
      scratch_ / "street.h5")});
  EXPECT_EQ(told(report), "explained: offset_jump");
  const Observation& seen = only(report);
  ASSERT_EQ(seen.jumps.size(), 1U);
  EXPECT_EQ(seen.jumps[0].frame, static_cast<std::size_t>(kJumpAt));
  EXPECT_NEAR(seen.jumps[0].size, 5.0, 0.1);
  EXPECT_TRUE(seen.freezes.empty());
  expect_said(report, "1 jump of the whole picture: 5 K at frame 70");
  const auto json = nlohmann::json::parse(report_json(report));
  EXPECT_EQ(json.at("verdict"), "explained");
  EXPECT_TRUE(json.at("gap").at("before").is_number());
  EXPECT_EQ(json.at("observations").at("street.h5").at("jumps").at(0).at("frame"), kJumpAt);
}

// Also one of a single value, as a camera without power may send.
TEST_F(Observations, AFrozenStreamIsNotTestable) {
  Frame noisy(32 * 24);
  flat(0, noisy);
  const std::vector<std::pair<Frame, capture::Stimulus>> streams{{noisy, capture::NoStimulus{}},
                                                                 {noisy, capture::Uniform{300.0}},
                                                                 {Frame(32 * 24, 30000), capture::Uniform{300.0}}};
  for (std::size_t i = 0; i < streams.size(); ++i) {
    const auto frozen = [&](int, Frame& plane) { plane = streams[i].first; };
    const std::string name = "frozen-" + std::to_string(i) + ".h5";
    const Report report = diagnosed({write(name, {32, 24}, 100, frozen, streams[i].second)});
    EXPECT_EQ(told(report), "not_testable:");
    const Observation& seen = only(report);
    ASSERT_EQ(seen.freezes.size(), 1U);
    EXPECT_EQ(seen.freezes[0], (std::pair<std::size_t, std::size_t>{1, 99}));
    EXPECT_TRUE(std::isnan(seen.noise));
    EXPECT_TRUE(report.defects.stuck.empty());
    expect_said(report, "frozen from frame 1 to 99 of 100");
  }
}

TEST_F(Observations, AFlatThatIsFrozenInTheEndIsStillTested) {
  Frame last(32 * 24);
  const auto file = write(
      "ends.h5", {32, 24}, 200,
      [&](int k, Frame& plane) {
        if (k < 120) flat(k, last);
        plane = last;
      },
      capture::Uniform{300.0});
  const Report report = diagnosed({file});
  EXPECT_NE(report.verdict, "not_testable");
  EXPECT_TRUE(report.observations.empty());
}

TEST_F(Observations, ThreeStuckPixelsOfALargeFrameAreFound) {
  constexpr Geometry kSize{320, 240};
  const std::vector<PixelPlace> places{{17, 3}, {201, 119}, {318, 238}};
  const auto stuck = [&](double kelvin) {
    return [this, &places, kelvin](int k, Frame& plane) {
      flat(k, plane);
      for (std::uint16_t& count : plane)
        count = static_cast<std::uint16_t>(count - 30000 + std::lround(100.0 * kelvin));
      for (const PixelPlace& p : places) plane[static_cast<std::size_t>(p.y * kSize.width + p.x)] = 31234;
    };
  };
  const auto shutter = write("shutter.h5", kSize, 40, stuck(300.0), capture::Uniform{300.0});
  const auto hot = write("hot.h5", kSize, 40, stuck(325.0), capture::Uniform{325.0});
  const Report report = diagnosed({shutter, hot}, {.maps = true});
  EXPECT_EQ(report.defects.stuck, places);
  EXPECT_TRUE(report.defects.noisy.empty());
  EXPECT_TRUE(has(report, "dead_pixels"));
  const std::vector<std::uint8_t>& dead = report.learned.maps.dead;
  ASSERT_EQ(dead.size(), kSize.pixels());
  EXPECT_EQ(std::ranges::count(dead, 1), 3);
  for (const PixelPlace& p : places) EXPECT_EQ(dead[static_cast<std::size_t>(p.y * kSize.width + p.x)], 1);
  expect_said(report, "3 stuck: (17, 3) (201, 119) (318, 238)");
  // The same without any stimulus.
  const Report field = diagnosed({write("field.h5", kSize, 40, stuck(300.0))});
  EXPECT_EQ(field.verdict, "not_testable");
  EXPECT_EQ(field.defects.stuck, places);
}

TEST_F(Observations, PatternsOutliersFlickerAndNoiseOfAField) {
  constexpr Geometry kSize{80, 60};
  std::vector<int> column;
  for (int x = 0; x < kSize.width; ++x) column.push_back(noise(12.0));
  const auto file = write("field.h5", kSize, 200, [&](int k, Frame& plane) {
    flat(k, plane);
    const int frame = noise(6.0);
    for (std::size_t p = 0; p < plane.size(); ++p) {
      plane[p] = static_cast<std::uint16_t>(plane[p] + frame + column[p % static_cast<std::size_t>(kSize.width)]);
    }
    plane[static_cast<std::size_t>(30 * kSize.width + 40)] += 300;
  });
  const Report report = diagnosed({file});
  const Observation& seen = only(report);
  EXPECT_TRUE(seen.jumps.empty());
  EXPECT_NEAR(seen.noise, 0.03, 0.003);
  EXPECT_NEAR(seen.flicker, 0.06, 0.015);
  EXPECT_NEAR(seen.column_pattern, 0.12, 0.03);
  EXPECT_EQ(seen.row_pattern, 0.0);
  EXPECT_EQ(seen.outliers, (std::vector<PixelPlace>{{40, 30}}));
}

// A street seen by a camera with tau 12.1 ms, whose profile states 11.
bed::Shot hand(int frames, sim::Path path) {
  return {.view = {240, 120}, .frames = frames, .tau_s = 0.0121, .path = std::move(path)};
}

TEST_F(Observations, ARestlessHandTellsTimeConstantAndRowDelay) {
  constexpr double kTau_s = 0.0121;
  constexpr double kDelay_s = 28e-6;
  bed::Shot shot = hand(400, bed::restless());
  shot.effects = {"row_delay:row_delay_s=2.8e-5"};
  const Report report = diagnosed({bed::shoot(shot, scratch_ / "hand.h5")});
  ASSERT_TRUE(only(report).motion);
  const FromMotion& motion = *only(report).motion;
  EXPECT_GT(motion.frames, 350U);
  EXPECT_GT(motion.fastest_px_s, 400.0);
  ASSERT_TRUE(motion.tau_s);
  EXPECT_NEAR(motion.tau_s->value.value, kTau_s, 0.03 * kTau_s);
  EXPECT_GT(motion.tau_s->gap.before, 1.1 * motion.tau_s->gap.after);
  ASSERT_TRUE(motion.row_delay_s);
  EXPECT_NEAR(motion.row_delay_s->value.value, kDelay_s, 0.05 * kDelay_s);
  expect_said(report, "time constant 1");
  const auto json = nlohmann::json::parse(report_json(report)).at("observations").begin()->at("motion");
  EXPECT_EQ(json.at("tau_s").at("value"), motion.tau_s->value.value);
  EXPECT_EQ(json.at("row_delay_s").at("ci95").size(), 2U);
  // The profile has 11 ms and no delay.
  const auto scale_of = [&](const char* effect, const char* key) {
    const auto found = std::ranges::find(report.effects, effect, &FoundEffect::name);
    return found == report.effects.end() ? 0.0 : found->parameters.at(key).value;
  };
  EXPECT_NEAR(scale_of("tau_global", "scale"), kTau_s / 0.011, 0.03 * kTau_s / 0.011);
  EXPECT_NEAR(scale_of("row_delay", "row_delay_s"), kDelay_s, 0.05 * kDelay_s);
  EXPECT_EQ(report.effects.size(), 2U);
}

// A frame's small acceleration and shear are mostly measurement error, which would bias the slope towards zero.
TEST_F(Observations, ASlowHandTellsTheRowDelay) {
  constexpr double kDelay_s = 28e-6;
  std::vector<sim::PathPoint> points;
  for (double t = -0.6; t < 5.5; t += 0.002) {
    points.push_back({t, 60.0 * std::sin(4.0 * t) + 0.6 * std::sin(40.0 * t), 25.0 * std::sin(6.3 * t)});
  }
  bed::Shot shot = hand(1000, sim::Path(std::move(points)));
  shot.effects = {"row_delay:row_delay_s=2.8e-5", "noise_level:scale=3"};
  const Report report = diagnosed({bed::shoot(shot, scratch_ / "slow.h5")});
  ASSERT_TRUE(only(report).motion);
  ASSERT_TRUE(only(report).motion->row_delay_s);
  const Estimate found = only(report).motion->row_delay_s->value;
  EXPECT_LT(found.low, kDelay_s);
  EXPECT_GT(found.high, kDelay_s);
  EXPECT_NEAR(found.value, kDelay_s, 0.05 * kDelay_s);
}

// A pan blurs all frames alike: a soft scene is equivalent to a slow pixel.
TEST_F(Observations, AnEvenPanTellsNoTimeConstant) {
  const Report report = diagnosed({bed::shoot(hand(400, sim::steady_pan(500.0)), scratch_ / "pan.h5")});
  ASSERT_TRUE(only(report).motion);
  EXPECT_NEAR(only(report).motion->usual_px_s, 500.0, 5.0);
  EXPECT_FALSE(only(report).motion->tau_s);
  EXPECT_FALSE(only(report).motion->row_delay_s);
  expect_said(report, "too evenly");
}

// Motion is known from the second full window on: here of one frame.
TEST_F(Observations, AFewFramesTellNothingOfTime) {
  const Report report = diagnosed({bed::shoot(hand(18, bed::restless()), scratch_ / "few.h5")});
  ASSERT_TRUE(only(report).motion);
  EXPECT_LE(only(report).motion->frames, 2U);
  EXPECT_FALSE(only(report).motion->tau_s);
  EXPECT_FALSE(only(report).motion->row_delay_s);
}

// Counts have no model, and a chopper's switches are no jumps of the camera.
TEST_F(Observations, AChopperInCountsBlamesNothingOnTheCamera) {
  const capture::Chopper chopper{.cold_k = 298.0, .on_s = {0.1, 0.3}, .off_s = {0.2, 0.5}, .level_k = {318.0, 308.0}};
  auto writer = must(capture::CaptureWriter::create(
      scratch_ / "chopper.h5", {.format = {.geometry = {48, 32}, .scale = {.unit = Unit::kCount, .scale = 1.0}}}));
  EXPECT_TRUE(writer->write_stimulus(chopper));
  double seen = 0.0;
  Frame plane(std::size_t{48} * 32);
  std::vector<int> own(plane.size());  // a fixed pattern, which can be followed
  for (int& offset : own) offset = noise();
  for (int k = 0; k < 200; ++k) {
    const double level = k >= 20 && k < 40 ? 2000.0 : k >= 60 && k < 100 ? 1000.0 : 0.0;
    seen += (level - seen) * 0.365;  // in 5 ms, of pixels of 11 ms
    for (std::size_t p = 0; p < plane.size(); ++p) {
      plane[p] = static_cast<std::uint16_t>(std::lround(29800.0 + seen) + own[p] + noise());
    }
    EXPECT_TRUE(writer->append(k * 0.005, static_cast<std::uint64_t>(k), plane.data()));
  }
  EXPECT_TRUE(writer->close());
  const Report report = diagnosed({scratch_ / "chopper.h5"});
  EXPECT_EQ(report.verdict, "not_testable");
  EXPECT_TRUE(report.effects.empty()) << told(report);
  EXPECT_FALSE(only(report).motion);
}

constexpr const char* kNoData = "BOLO_TEST_DATA is not set";

TEST_F(Observations, OfARealDriveItSaysWhatItCanTellAndNoMore) {
  if (real("").empty()) GTEST_SKIP() << kNoData;
  const Report report = diagnosed({real("a65_drive_a.h5")});
  EXPECT_EQ(report.verdict, "explained");
  EXPECT_GT(report.gap.before, report.gap.after);
  EXPECT_TRUE(has(report, "fpn_offset")) << told(report);
  for (const char* name :
       {"tau_global", "tau_spread", "slow_pole", "row_delay", "optical_psf", "crosstalk", "jitter"}) {
    EXPECT_FALSE(has(report, name)) << told(report);
  }
  for (const char* name : {"coarse_quantisation", "noise_level", "tau_spread"}) {  // the profile has kelvin
    EXPECT_TRUE(std::ranges::count(report.not_identifiable, name, &NotIdentifiable::effect)) << name;
  }
  const Observation& seen = only(report);
  EXPECT_TRUE(seen.jumps.empty());
  EXPECT_EQ(seen.unit, "count");
  EXPECT_NEAR(seen.column_pattern, 3.3, 1.0);
  EXPECT_GT(seen.outliers.size(), 100U);
  EXPECT_LT(seen.outliers.size(), 1000U);
  expect_said(report, "counts rms");
}

// Rows instead of columns, and a frame whose blocks begin elsewhere. All of its pixels follow the scene: none is dead.
TEST_F(Observations, OfARealDriveTurnedAndCroppedItSaysTheSame) {
  if (real("").empty()) GTEST_SKIP() << kNoData;
  for (const bool transposed : {true, false}) {
    const auto file = transposed ? part_of("a65_drive_a.h5", 0, 0, {640, 512}, true)
                                 : part_of("a65_drive_a.h5", 5, 3, {627, 507}, false);
    const Report report = diagnosed({file});
    EXPECT_EQ(told(report), "explained: fpn_offset") << transposed;
    EXPECT_TRUE(report.defects.noisy.empty()) << transposed;
    std::filesystem::remove(file);
  }
}

TEST_F(Observations, OfRealBlackBodiesInCounts) {
  if (real("").empty()) GTEST_SKIP() << kNoData;
  const Report flat = diagnosed({real("atto320_blackbody_25C.h5")});
  EXPECT_TRUE(has(flat, "flicker")) << told(flat);
  EXPECT_FALSE(has(flat, "tau_global"));
  // The same without a stimulus.
  const Report report = diagnosed({altered("atto320_blackbody_25C.h5", [](std::size_t) { return 0; })});
  EXPECT_EQ(report.verdict, "not_testable");
  const Observation& seen = only(report);
  EXPECT_NEAR(seen.noise, 2.1, 0.2);
  EXPECT_GT(seen.column_pattern, 0.5);
  EXPECT_EQ(report.defects.stuck.size(), 2U);
  const Report colder = diagnosed({real("atto320_blackbody_20C.h5")});
  for (const char* effect : {"flicker", "stripes", "dead_pixels"}) EXPECT_TRUE(has(colder, effect)) << told(colder);
  EXPECT_GT(colder.gap.before, colder.gap.after);
}

TEST_F(Observations, OfRealRecordingsWithoutAnEventThereIsNone) {
  if (real("").empty()) GTEST_SKIP() << kNoData;
  for (const char* name : {"lepton_cat.h5", "lepton_hand_fast.h5", "lepton_noise_01.h5", "lepton_possum.h5"}) {
    const Report report = diagnosed({real(name)});
    EXPECT_TRUE(only(report).jumps.empty()) << name << describe(only(report)).front();
    EXPECT_TRUE(only(report).freezes.empty()) << name;
    EXPECT_TRUE(report.defects.stuck.empty()) << name;
    EXPECT_LT(only(report).outliers.size(), 10U) << name;
  }
}

TEST_F(Observations, TenResetsOfTheOffsetInARealRecording) {
  std::vector<int> level(200, 0);
  std::vector<std::pair<std::size_t, int>> truth;
  int sum = 0;
  for (std::size_t i = 0; i < 10; ++i) {
    const std::size_t at = 9 + 15 * i;
    const int size = (i % 2 == 0 ? 1 : -1) * (78 + 11 * static_cast<int>(i));
    truth.emplace_back(at, size);
    sum += size;
    std::fill(level.begin() + static_cast<long>(at), level.end(), sum);
  }
  const auto file = altered("lepton_possum.h5", [&](std::size_t k) { return level[k]; });
  if (file.empty()) GTEST_SKIP() << kNoData;
  const Report report = diagnosed({file});
  const Observation& seen = only(report);
  ASSERT_EQ(seen.jumps.size(), truth.size()) << report_summary(report);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_EQ(seen.jumps[i].frame, truth[i].first);
    EXPECT_NEAR(seen.jumps[i].size, truth[i].second, 3.0);
  }
}

TEST_F(Observations, AFlatFieldEventInARealRecording) {
  const auto file = altered("lepton_cat.h5", [](std::size_t k) { return k >= 40 ? -31 : 0; });
  if (file.empty()) GTEST_SKIP() << kNoData;
  const Observation seen = only(diagnosed({file}));
  ASSERT_EQ(seen.jumps.size(), 1U);
  EXPECT_EQ(seen.jumps[0].frame, 40U);
  EXPECT_NEAR(seen.jumps[0].size, -31.0, 2.0);
}

}  // namespace bolo::diagnose::observations_test
