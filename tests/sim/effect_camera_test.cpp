// Whole cameras with effects: agreement with the nominal camera, seeds, threads, combinations.
#include "tests/sim/effect_support.hpp"

namespace bolo::sim::effect_camera_test {

using namespace testing;

std::unique_ptr<const Field> street_pan(Geometry view) {
  const auto street = make_street(view, 3);
  auto field = pan_over(*street, steady_pan(240), {5, 0}, view, -0.2, 0.1);
  EXPECT_TRUE(field);
  return std::move(*field);
}

// An effect of size zero equals the nominal camera within the tolerance of the time steps.
TEST(EffectCamera, WithAnEffectOfSizeZeroIsTheNominalCamera) {
  const Geometry view{30, 12};
  const std::vector<std::function<std::unique_ptr<const Field>()>> fields{
      one_pulse,
      [] {
        return make_bars({285, 310, 12, 6, 0.25, 300});
      },
      [&] { return street_pan(view); }};
  for (const auto& field : fields) {
    const Frames nominal = run(noisy_camera(view), field(), 18);
    for (const auto& effect : {"tau_global:scale=1", "row_delay:row_delay_s=0", "crosstalk:coupling=0",
                               "slow_pole:share=0", "iir:alpha=1", "vignetting:corner_loss=0"}) {
      const Frames other = run(with(noisy_camera(view), {effect}), field(), 18);
      EXPECT_EQ(other.truth, nominal.truth);
      double worst = 0.0;
      for (std::size_t k = 0; k < 18; ++k) {
        for (std::size_t i = 0; i < view.pixels(); ++i) {
          worst = std::max(worst, std::abs(static_cast<double>(other.shown[k][i] - nominal.shown[k][i])));
        }
      }
      EXPECT_LT(worst, 0.003) << effect;
    }
  }
}

std::vector<std::string_view> every_effect() {
  std::vector<std::string_view> names;
  for (const EffectDescription& effect : effect_descriptions()) names.push_back(effect.name);
  return names;
}

class Every : public ::testing::TestWithParam<std::string_view> {};

TEST_P(Every, IsTheSameForTheSameSeedsWhateverTheThreads) {
  CameraSettings camera = with(noisy_camera({21, 13}), {GetParam()});
  camera.threads = 1;
  const auto bars = [] { return make_bars({285, 310, 12, 6, 0.25, 300}); };
  const Frames first = run(camera, bars(), 30);
  for (const int threads : {1, 3, 20}) {
    camera.threads = threads;
    EXPECT_EQ(run(camera, bars(), 30).shown, first.shown) << threads;
  }
}

// Every form gives finite values at every bound of its range; in uint16 as well.
TEST_P(Every, ShowsNumbersAllOverItsRange) {
  const EffectDescription& effect = *find_effect(GetParam());
  std::vector<EffectSpec> specs{{std::string(GetParam()), "", {}}};
  for (const std::string_view form : effect.forms) specs.push_back({std::string(GetParam()), std::string(form), {}});
  for (const Parameter& p : effect.parameters) {
    for (const double value : {p.accepted.low, p.accepted.high}) {
      specs.push_back({std::string(GetParam()), "", {{std::string(p.key), value}}});
    }
  }
  for (const EffectSpec& spec : specs) {
    for (const Geometry geometry : {Geometry{1, 1}, Geometry{9, 6}}) {
      CameraSettings camera = noisy_camera(geometry);
      camera.effects = {spec};
      const Frames frames = run(camera, one_pulse(), 5);
      for (const auto& frame : frames.shown) {
        EXPECT_TRUE(std::ranges::all_of(frame, [](float v) { return std::isfinite(v); }))
            << spec.name << ' ' << spec.form;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Effects, Every, ::testing::ValuesIn(every_effect()),
                         [](const auto& each) { return std::string(each.param); });

TEST(EffectCamera, CombinesAllEffectsOfTheCatalogue) {
  CameraSettings camera = noisy_camera({16, 12});
  for (const EffectDescription& effect : effect_descriptions()) {
    if (effect.in_catalogue) camera = with(camera, {effect.name});
  }
  const auto frames = run(camera, make_bars({285, 310, 12, 6, 0.25, 300}), 40);
  for (const auto& frame : frames.shown) {
    for (const float v : frame) EXPECT_TRUE(v > 250.0F && v < 350.0F) << v;
  }
}

// Row delay, integration window and tau combined: rows of a ramp lag by tau plus half the window, minus their delay.
TEST(EffectCamera, EffectsOfTimeAdd) {
  const CameraSettings camera =
      with(ideal_camera({8, 10}), {"tau_global:scale=1.2", "row_delay:row_delay_s=5e-5",
                                   "integration_window:window_s=0.002", "clock_skew:skew=0.01"});
  const auto frames = run(camera, Ramp::field(camera.geometry, 0.3), 20);
  for (std::size_t k = 0; k < 20; ++k) {
    for (std::size_t y = 0; y < 10; ++y) {
      const double expected =
          1.01 * kPeriod * static_cast<double>(k) + 5e-5 * static_cast<double>(y) - 1.2 * kTau - 0.001;
      EXPECT_NEAR(Ramp::time_of(at(frames.shown[k], 8, 3, y), 3), expected, 2e-6) << k << ' ' << y;
    }
  }
}

TEST(EffectCamera, TheTruthIsWhatThereIsToSee) {
  const auto nominal = run(ideal_camera({8, 4}), Ramp::field({8, 4}, 0.3), 10);
  const auto other = run({8, 4}, {"clock_skew", "emissivity", "frame_loss"}, Ramp::field({8, 4}, 0.3), 10);
  EXPECT_EQ(other.truth, nominal.truth);
  EXPECT_NE(other.shown, nominal.shown);
}

// Patterns depend on the camera's seed, noise on the capture's.
TEST(EffectCamera, ACameraKeepsItsPatternFromCaptureToCapture) {
  const auto pattern = [](const char* effect, std::uint64_t camera_seed, std::uint64_t seed) {
    CameraSettings camera = with(ideal_camera({24, 18}), {effect});
    camera.camera_seed = camera_seed;
    camera.readout.seed = seed;
    return run(camera, make_chopper({295, {-1.0}, {0.012}, {320}}), 6).shown.back();
  };
  for (const char* effect : {"fpn_offset", "fpn_gain", "tau_spread", "drift:time_s=0.1", "dead_pixels:form=stuck",
                             "nuc_freeze:at_s=-1,freeze_frames=1"}) {
    EXPECT_EQ(pattern(effect, 5, 1), pattern(effect, 5, 2)) << effect;
    EXPECT_NE(pattern(effect, 5, 1), pattern(effect, 6, 1)) << effect;
  }
  CameraSettings camera = with(ideal_camera({24, 18}), {"fpn_offset"});
  camera.readout.seed = 5;  // equals the default camera seed
  EXPECT_EQ(run(camera, make_chopper({295, {-1.0}, {0.012}, {320}}), 6).shown.back(), pattern("fpn_offset", 5, 1));
}

}  // namespace bolo::sim::effect_camera_test
