// Whole diagnoses of small simulated sessions of the blind check's bench.
#include "src/diagnose/diagnose.hpp"
#include "tests/diagnose/blind_bench.hpp"

namespace bolo::diagnose::diagnose_test {

using testing::diagnosed;
using testing::has;
using testing::told;

constexpr double kHalfPeriodPx = 10.0;  // of the bench's bars

class Diagnosis : public testing::BlindBench {
 protected:
  // Diagnosis of six 32x24 captures of the bench, all with the effect.
  Report of(const std::string& effect, std::uint64_t seed, const Options& options = {}) {
    return diagnosed(bench({.seed = seed}, {effect}), options);
  }
};

TEST_F(Diagnosis, FindsNothingWhereNothingIs) {
  const Report report = diagnosed(bench({.seed = 11}));
  EXPECT_EQ(told(report), "no_gap:") << report.unexplained.where;
  EXPECT_NEAR(report.gap.before, 1.0, 0.05);
  EXPECT_NEAR(report.gap.after, 1.0, 0.05);
  EXPECT_TRUE(report.warnings.empty());
  EXPECT_TRUE(report.not_identifiable.empty());
  EXPECT_EQ(report.inputs.size(), 6U);
  EXPECT_NEAR(report.noise_floor_k, 0.0301, 0.0005);
  EXPECT_EQ(report.frames, 2000U);
}

// Still bars in closed form: pixels that average over 0.85 of their pitch, optics that blur by 0.25 px.
Recording bars_through_small_pixels() {
  constexpr double kAperture_px = 0.85;
  constexpr double kBlur_px = 0.25;
  const auto integral = [](double x) {  // integral of a blurred step
    const double z = x / kBlur_px;
    return 0.5 * x * std::erfc(-z / std::numbers::sqrt2) +
           kBlur_px * std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  };
  const auto step = [&](double x) {
    return (integral(x + kAperture_px / 2.0) - integral(x - kAperture_px / 2.0)) / kAperture_px;
  };
  Recording r = testing::blank(testing::slanted_bars(0.0), 150);
  const auto& bars = std::get<capture::BarTarget>(r.stimulus);
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0.0, 0.03);
  for (int p = 0; p < testing::kWidth * testing::kHeight; ++p) {
    const double x = p % testing::kWidth - bars.slant_px_per_row * (p / testing::kWidth) - 3.37;
    const double u = std::remainder(x - bars.bar_width_px / 2.0, bars.period_px);  // from the centre of a hot bar
    const double hot = step(bars.bar_width_px / 2.0 - std::abs(u));
    for (int k = 0; k < 150; ++k) {
      r.values(k, p) = static_cast<float>(bars.cold_k + (bars.hot_k - bars.cold_k) * hot + noise(random));
    }
  }
  return r;
}

TEST_F(Diagnosis, AllowsForPixelsThatDoNotFillTheirPlace) {
  std::mt19937 random(6);
  std::normal_distribution<double> noise(0.0, 0.03);
  const Recording dark = testing::shutter(200, [&](int, int, int) { return noise(random); });
  const Report report = diagnosed({testing::write(dark, scratch_ / "shutter.h5"),
                                   testing::write(bars_through_small_pixels(), scratch_ / "still.h5")});
  EXPECT_EQ(told(report), "no_gap:") << report.unexplained.where;
  EXPECT_NEAR(report.stimulus.at("still.h5").at("aperture_px"), 0.85, 0.03);
}

// At a slow camera's rate one second of a chopper has few frames, but as many edges.
TEST_F(Diagnosis, OfASlowCameraSeesWhatAChopperShows) {
  std::vector<std::filesystem::path> files;
  sim::CameraSettings camera = testing::noisy_camera();
  camera.effects.push_back(*sim::parse_effect("radiometric_nonlinearity"));
  for (const capture::Stimulus& stimulus :
       {capture::Stimulus(capture::Uniform{300.0}), {testing::odd_chopper()}, {testing::slanted_bars(70.0)}}) {
    const Recording slow = testing::every(2, testing::record(camera, stimulus, 240));
    files.push_back(testing::write(slow, scratch_ / (std::to_string(files.size()) + ".h5")));
  }
  const Report report = diagnosed(files);
  EXPECT_EQ(told(report), "explained: radiometric_nonlinearity") << report.unexplained.where;
}

// Three cells of a short capture with few edges.
TEST_F(Diagnosis, NamesWhatExplainsAllInFewCells) {
  std::vector<std::filesystem::path> files;
  sim::CameraSettings camera = testing::noisy_camera();
  camera.effects.push_back(*sim::parse_effect("clock_skew:skew=0.0015"));
  capture::Chopper chopper = testing::odd_chopper();
  for (auto* of : {&chopper.on_s, &chopper.off_s, &chopper.level_k}) of->resize(4);
  for (const capture::Stimulus& stimulus : {capture::Stimulus(capture::Uniform{300.0}), {chopper}}) {
    const Recording slow = testing::every(3, testing::record(camera, stimulus, 156));
    files.push_back(testing::write(slow, scratch_ / (std::to_string(files.size()) + ".h5")));
  }
  const Report report = diagnosed(files);
  EXPECT_EQ(told(report), "explained: clock_skew") << report.unexplained.where;
}

// Telegraph noise may keep a pixel at one level for a whole short capture and at the other in the next.
TEST_F(Diagnosis, LeavesNothingOverOfPixelsThatRestBetweenJumps) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0.0, 0.03);
  std::vector<std::filesystem::path> files;
  for (const bool second : {false, true}) {
    const Recording r = testing::shutter(200, [&](int k, int row, int column) {
      const int pixel = (row * testing::kWidth + column) % 255;  // three of each kind
      const bool high = pixel == 3 ? k / 30 % 2 != 0 : pixel == 35 && second;
      return noise(random) + (high ? 0.2 : 0.0);
    });
    files.push_back(testing::write(r, scratch_ / (second ? "second.h5" : "first.h5")));
  }
  const Report report = diagnosed(files);
  EXPECT_EQ(told(report), "explained: rts") << report.unexplained.where;
}

// Magnification oscillates by 3 %: a prediction error that looks like shifts and makes any candidate seem a large gain.
TEST_F(Diagnosis, NamesNothingForPansThatNothingExplains) {
  const auto record = [](const capture::Stimulus& stimulus) {
    return testing::every(2, testing::record(testing::noisy_camera(), stimulus, 160));
  };
  std::vector<std::filesystem::path> files{testing::write(record(capture::Uniform{300.0}), scratch_ / "shutter.h5")};
  for (const double velocity : {70.0, -320.0}) {
    Recording r = record(testing::slanted_bars(velocity));
    const Series sharp = r.values;
    for (int k = 0; k < r.frames(); ++k) {
      const double scale = 1.0 + 0.03 * std::sin(14.5 * r.t[static_cast<std::size_t>(k)]);
      for (int p = 0; p < testing::kWidth * testing::kHeight; ++p) {
        const double x = std::clamp(15.5 + (p % testing::kWidth - 15.5) * scale, 0.0, testing::kWidth - 1.001);
        const int from = p - p % testing::kWidth + static_cast<int>(x);
        const auto share = static_cast<float>(x - std::floor(x));
        r.values(k, p) = (1.0F - share) * sharp(k, from) + share * sharp(k, from + 1);
      }
    }
    files.push_back(testing::write(r, scratch_ / (velocity > 0.0 ? "slow.h5" : "fast.h5")));
  }
  EXPECT_EQ(told(diagnosed(files)), "unknown_effect:");
}

struct Case {
  std::string effect;
  std::string name;
  std::string key;
  double truth = 0.0;
  double tolerance = 0.0;  // relative to the estimate
};

class OneEffect : public Diagnosis, public ::testing::WithParamInterface<Case> {};

TEST_P(OneEffect, IsNamedFirstWithItsSize) {
  const Case& c = GetParam();
  const Report report = of(c.effect, 12);
  ASSERT_FALSE(report.effects.empty()) << told(report);
  const FoundEffect& first = report.effects.front();
  ASSERT_EQ(first.name, c.name) << told(report);
  EXPECT_GT(first.confidence, 0.9);
  ASSERT_TRUE(first.parameters.contains(c.key));
  const Estimate& e = first.parameters.at(c.key);
  EXPECT_NEAR(e.value / c.truth, 1.0, c.tolerance);
  EXPECT_LE(e.low, e.value);
  EXPECT_GE(e.high, e.value);
  EXPECT_GT(e.high - e.low, 0.0);
  EXPECT_LT(e.high - e.low, 0.6 * std::abs(c.truth));
  EXPECT_LT(report.gap.after, 1.1) << told(report);
  EXPECT_LT(report.gap.after, report.gap.before + 0.01);
  EXPECT_NE(report.verdict, "no_gap") << told(report);
  for (const auto& [capture, errors] : report.stimulus) {
    const auto phase = errors.find("phase_px");
    EXPECT_TRUE(phase == errors.end() || std::abs(phase->second) <= kHalfPeriodPx) << capture;
  }
}

INSTANTIATE_TEST_SUITE_P(
    OfTheCatalogue, OneEffect,
    ::testing::Values(Case{"tau_global:scale=1.1", "tau_global", "scale", 1.1, 0.01},
                      Case{"row_delay:row_delay_s=2.8e-5", "row_delay", "row_delay_s", 2.8e-5, 0.1},
                      Case{"optical_psf:sigma_px=0.7", "optical_psf", "sigma_px", 0.7, 0.05},
                      Case{"flicker:sigma_k=0.009", "flicker", "sigma_k", 0.009, 0.15},
                      Case{"fpn_offset:pixel_k=0.03,column_k=0.015", "fpn_offset", "pixel_k", 0.03, 0.1}),
    [](const auto& made) { return made.param.name; });

// With deviating levels both forms of emissivity are tried.
TEST_F(Diagnosis, NamesEachAlternativeOnce) {
  const Report report = diagnosed(bench({.seed = 12, .geometry = {64, 24}}, {"slow_pole:share=0.05,slow_tau_s=0.15"}));
  ASSERT_FALSE(report.effects.empty()) << told(report);
  const FoundEffect& first = report.effects.front();
  EXPECT_GT(first.alternatives.size(), 1U);
  std::set<std::string> once{first.name};
  for (const Alternative& other : first.alternatives) EXPECT_TRUE(once.insert(other.name).second) << other.name;
}

class Withheld : public Diagnosis, public ::testing::WithParamInterface<const char*> {};

TEST_P(Withheld, IsSaidToBeUnknown) {
  const std::string effect = GetParam();
  const std::string name = effect.substr(0, effect.find(':'));
  const Report report = of(effect, 13, {.withheld = {name}});
  EXPECT_EQ(report.verdict, "unknown_effect") << told(report);
  EXPECT_TRUE(report.effects.empty()) << told(report);  // no other effect is named in its place
  EXPECT_FALSE(report.unexplained.where.empty());
  EXPECT_FALSE(report.unexplained.stage.empty());
  EXPECT_LT(report.unexplained.p_value, 1e-3);
  EXPECT_EQ(report.withheld, std::vector<std::string>{name});
}

INSTANTIATE_TEST_SUITE_P(OfTheCatalogue, Withheld,
                         ::testing::Values("tau_global:scale=1.08", "tau_spread:rms=0.03",
                                           "row_delay:row_delay_s=2.8e-5", "flicker:sigma_k=0.009",
                                           "fpn_offset:pixel_k=0.03,column_k=0.015", "vignetting:corner_loss=0.04"),
                         [](const auto& made) {
                           return std::string(made.param, std::string_view(made.param).find(':'));
                         });

// Heating that grows linearly, unlike the effect's standard form, which saturates within the frame.
class EvenHeat : public Diagnosis {
 protected:
  static constexpr double kHeat_k = 0.1;

  // Two flat fields, heated row by row, with a fixed offset in each pixel.
  Report heated(double offset_k) {
    std::mt19937 random(16);
    std::normal_distribution<double> gauss;
    std::array<double, std::size_t{testing::kWidth} * testing::kHeight> offset{};
    for (double& one : offset) one = offset_k * gauss(random);
    std::vector<std::filesystem::path> files;
    for (const double kelvin : {300.0, 325.0}) {
      const auto fill = [&](int, std::vector<std::uint16_t>& plane) {
        for (std::size_t p = 0; p < plane.size(); ++p) {
          const double row = std::floor(static_cast<double>(p) / testing::kWidth) / (testing::kHeight - 1);
          const double value = kelvin + kHeat_k * row + offset[p] + 0.03 * gauss(random);
          plane[p] = static_cast<std::uint16_t>(std::lround(100.0 * value));
        }
      };
      const auto file = scratch_.path() / ("flat-" + std::to_string(files.size()) + ".h5");
      files.push_back(testing::write_capture<std::uint16_t>(file, {testing::kWidth, testing::kHeight}, 240, fill,
                                                            capture::Uniform{kelvin}));
    }
    return diagnosed(files);
  }
};

TEST_F(EvenHeat, IsNoPatternOfPixels) {
  const Report report = heated(0.0);
  ASSERT_EQ(told(report), "explained: self_heating") << report.unexplained.where;
  EXPECT_NEAR(0.95 * report.effects[0].parameters.at("amplitude_k").value, kHeat_k, 0.02 * kHeat_k);
}

// The fixed pattern's map must not absorb the heating.
TEST_F(EvenHeat, IsToldFromAPattern) {
  const Report report = heated(0.03);
  ASSERT_EQ(told(report), "explained: fpn_offset self_heating") << report.unexplained.where;
  EXPECT_NEAR(0.95 * report.effects[1].parameters.at("amplitude_k").value, kHeat_k, 0.1 * kHeat_k);
}

// Coarse quantisation whitens the noise, and at low noise shifts whole frames alike.
TEST_F(Diagnosis, TellsAFilterBehindCoarseStepsByLateEdges) {
  const Report report = diagnosed(bench({.seed = 90417}, {}, Kind::kPair, 1));
  const auto& hidden = session_.effects;
  ASSERT_EQ(hidden[0].name + " " + hidden[1].name, "coarse_quantisation iir");
  EXPECT_EQ(report.verdict, "explained") << report.unexplained.where;
  ASSERT_EQ(report.effects.size(), 2U) << told(report);
  const auto iir = std::ranges::find(report.effects, "iir", &FoundEffect::name);
  ASSERT_NE(iir, report.effects.end()) << told(report);
  EXPECT_NEAR(iir->parameters.at("alpha").value, hidden[1].values.at("alpha"), 0.01);
}

// Level errors of 5 % of the contrast bias the path through lost frames unless the levels are fitted.
TEST_F(Diagnosis, FindsLossesBeforeABenchWhoseLevelsAreOff) {
  const Report report = diagnosed(bench({.seed = 90417, .imperfect = true}, {}, Kind::kSingle, 9));
  ASSERT_EQ(session_.effects.front().name, "frame_loss");
  EXPECT_EQ(told(report), "explained: frame_loss") << report.unexplained.where;
}

TEST_F(Diagnosis, DoesNotDependOnTheNumberOfThreads) {
  const auto files = bench({.seed = 14}, {"tau_global:scale=1.1"}, Kind::kEffectFree, 0, 3);
  const Report a = diagnosed(files, {.threads = 1});
  const Report b = diagnosed(files, {.threads = 3});
  EXPECT_TRUE(has(a, "tau_global")) << told(a);
  EXPECT_EQ(told(a), told(b));
  EXPECT_EQ(a.unexplained.where, b.unexplained.where);
  EXPECT_DOUBLE_EQ(a.gap.before, b.gap.before);
  EXPECT_DOUBLE_EQ(a.gap.after, b.gap.after);
}

TEST_F(Diagnosis, OfAShutterAloneSaysWhatItCannotTell) {
  const Report report = diagnosed(bench({.seed = 15}, {"tau_global:scale=1.1"}, Kind::kEffectFree, 0, 1));
  EXPECT_EQ(report.verdict, "no_gap") << told(report);
  const auto missing = std::ranges::find(report.not_identifiable, "tau_global", &NotIdentifiable::effect);
  ASSERT_NE(missing, report.not_identifiable.end());
  EXPECT_FALSE(missing->needs.empty());
}

// --- Learned corrections against the simulator's settings.

class Learning : public testing::BlindBench {
 protected:
  Learned learn(const std::vector<std::string>& effects, Geometry geometry, std::size_t captures) {
    const auto files = bench({.seed = 9, .geometry = geometry}, effects, Kind::kEffectFree, 0, captures);
    return testing::diagnosed(files, {.maps = true}).learned;
  }

  sim::CameraSettings camera() const {
    sim::CameraSettings camera;
    camera.geometry = session_.geometry;
    camera.effects = session_.effects;
    camera.camera_seed = session_.camera_seed;
    return camera;
  }
  double unevenness(const model::PixelMaps& maps, double kelvin) const {
    return testing::unevenness(camera(), maps, kelvin);
  }
};

// A frame larger than the diagnosis' grid.
TEST_F(Learning, OffsetsOfEveryPixelOfALargeFrame) {
  const Learned learned = learn({"fpn_offset:pixel_k=0.05,column_k=0.02"}, {100, 60}, 2);
  ASSERT_EQ(learned.maps.geometry, (Geometry{100, 60}));
  ASSERT_EQ(learned.maps.offset.size(), 6000U);
  EXPECT_GT(unevenness({}, 300.0), 0.05);
  EXPECT_LT(unevenness(learned.maps, 300.0), 0.003);
  EXPECT_LT(unevenness(learned.maps, 325.0), 0.003);
  EXPECT_TRUE(learned.maps.dead.empty());
  EXPECT_TRUE(learned.maps.tau_s.empty()) << "nothing was found of it";
}

TEST_F(Learning, GainsAndShadingAreUndoneTogether) {
  const Learned learned = learn({"fpn_gain:rms=0.008", "vignetting:corner_loss=0.02"}, {32, 24}, 6);
  ASSERT_FALSE(learned.maps.gain.empty());
  EXPECT_GT(unevenness({}, 320.0), 0.2);
  EXPECT_LT(unevenness(learned.maps, 320.0), 0.02);
  EXPECT_LT(unevenness(learned.maps, 295.0), 0.02);
}

TEST_F(Learning, DeadPixelsOfALargeFrame) {
  const Learned learned = learn({"dead_pixels:fraction=0.004"}, {100, 60}, 2);
  ASSERT_EQ(learned.maps.dead.size(), 6000U);
  const std::vector<float> cold = testing::flat_frame(camera(), 300.0);
  const std::vector<float> hot = testing::flat_frame(camera(), 325.0);
  int dead = 0;
  for (std::size_t p = 0; p < cold.size(); ++p) {
    const bool answers = std::abs(hot[p] - cold[p] - 25.0F) < 1.0F;
    EXPECT_EQ(learned.maps.dead[p] == 0, answers) << p;
    dead += answers ? 0 : 1;
  }
  EXPECT_EQ(dead, 24);
}

TEST_F(Learning, ConstantsOfTheCameraAsAWhole) {
  const Learned learned = learn({"iir:alpha=0.7", "emissivity:emissivity=0.95,surroundings_k=290"}, {32, 24}, 6);
  const model::Undo& undo = learned.profile.undo;
  EXPECT_EQ(undo.filter, model::FrameFilter::kRecursive);
  EXPECT_NEAR(undo.filter_weight, 0.7, 0.02);
  EXPECT_NEAR(undo.emissivity, 0.95, 0.005);
  EXPECT_NEAR(undo.reflected_k, 290.0, 3.0);
  EXPECT_TRUE(learned.maps.empty());
}

}  // namespace bolo::diagnose::diagnose_test
