// Closed-form predictions against the simulator, which steps every pixel through time.
#include "src/diagnose/model.hpp"
#include "tests/diagnose/bench.hpp"
#include "tests/test.hpp"

namespace bolo::diagnose::response_test {

using testing::ideal_camera;

// One camera, described for the simulator and for the diagnosis.
struct Case {
  std::string name;
  std::vector<std::string> effects;
  std::function<void(State&)> apply;
  double window_s = 0.0;  // the simulator's ends at the frame's time, the diagnosis' is centred on it
  double tolerance_k = 0.003;
  sim::StimulusError error{};  // of the chopper
};

std::vector<Case> cases() {
  sim::StimulusError blade;
  blade.softness_s = 0.004;
  return {
      {"nominal", {}, [](State&) {}},
      {"slower", {"tau_global:scale=1.2"}, [](State& s) { s.camera.response.tau_s *= 1.2; }},
      {"slow_pole",
       {"slow_pole:share=0.03,slow_tau_s=0.2"},
       [](State& s) {
         s.camera.response.slow_share = 0.03;
         s.camera.response.slow_tau_s = 0.2;
       }},
      {"blurred", {"optical_psf:sigma_px=0.8"}, [](State& s) { s.camera.response.blur_px2 = 0.64; }},
      {"coupled", {"crosstalk:coupling=0.05"}, [](State& s) { s.camera.response.coupling = 0.05; }},
      {"window", {"integration_window:window_s=0.003"}, [](State& s) { s.camera.response.window_s = 0.003; }, 0.003},
      {"rows", {"row_delay:row_delay_s=4e-5"}, [](State& s) { s.camera.row_delay_s = 4e-5; }},
      {"halves",
       {"row_delay:row_delay_s=4e-5,form=halves"},
       [](State& s) {
         s.camera.row_delay_s = 4e-5;
         s.camera.two_halves = true;
       }},
      {"recursive",
       {"iir:alpha=0.7"},
       [](State& s) {
         s.camera.response.filter = FrameFilter::kRecursive;
         s.camera.response.alpha = 0.7;
       }},
      {"box",
       {"iir:alpha=0.7,form=box"},
       [](State& s) {
         s.camera.response.filter = FrameFilter::kBox;
         s.camera.response.alpha = 0.7;
       }},
      {"skewed", {"clock_skew:skew=5e-4"}, [](State& s) { s.camera.clock_skew = 5e-4; }},
      {"radiance",
       {"radiometric_nonlinearity"},
       [](State& s) {
         s.camera.radiance = 1.0;
         s.camera.edges_in_temperature = true;
       }},
      {"emissivity",
       {"emissivity:emissivity=0.95,surroundings_k=295"},
       [](State& s) {
         s.camera.reflected = 0.05;
         s.camera.edges_in_temperature = true;
       }},
      {"soft_blade", {}, [](State& s) { s.stimuli[0].softness_s = 0.004; }, 0.0, 0.003, blade},
  };
}

class Prediction : public ::testing::TestWithParam<Case> {
 protected:
  // Largest difference between prediction and simulation, K, without the frame's border: there the simulator has no
  // neighbours, unlike the Fourier series.
  double largest(const capture::Stimulus& stimulus, int frames, const sim::StimulusError& error = {}) {
    const Case& c = GetParam();
    sim::CameraSettings camera = ideal_camera();
    for (const std::string& text : c.effects) {
      camera.effects.push_back(*must(sim::parse_effect(text)));
    }
    const Session session = testing::session_of({testing::record(camera, stimulus, frames, error)});
    State state = nominal_state(session, {});
    c.apply(state);
    StimulusState& s = state.stimuli[0];
    s.delay_s = c.window_s / 2.0;
    for (std::size_t k = 0; k < s.shift_px.size(); ++k) {
      const double t_s = session.recordings[0].t[k] * (1.0 + state.camera.clock_skew) - c.window_s / 2.0;
      s.shift_px[k] = std::get<capture::BarTarget>(stimulus).velocity_px_s * t_s;
      s.speed_px_s[k] *= 1.0 + state.camera.clock_skew;
    }
    std::vector<int> inner;
    for (int p = 0; p < session.grid.pixels(); ++p) {
      const int row = session.grid.row_of(p);
      const int column = session.grid.column_of(p);
      const bool near = row < 5 || column < 5 || row >= testing::kHeight - 5 || column >= testing::kWidth - 5;
      if (!near) inner.push_back(p);
    }
    const Series predicted = predict(session, 0, state, inner);
    double worst = 0.0;
    for (int k = 0; k < frames; ++k) {
      for (std::size_t j = 0; j < inner.size(); ++j) {
        const float difference = predicted(k, static_cast<Eigen::Index>(j)) - session.recordings[0].values(k, inner[j]);
        worst = std::max(worst, std::abs(static_cast<double>(difference)));
      }
    }
    return worst;
  }
};

TEST_P(Prediction, AgreesOnPulsesAtOddTimesAndOnBarsThatMoveOrStand) {
  EXPECT_LT(largest(testing::odd_chopper(), 240, GetParam().error), GetParam().tolerance_k);
  for (const double velocity : {68.3, -317.9}) {
    EXPECT_LT(largest(testing::slanted_bars(velocity), 60), GetParam().tolerance_k) << velocity;
  }
  EXPECT_LT(largest(testing::slanted_bars(0.0), 4), GetParam().tolerance_k);
}

INSTANTIATE_TEST_SUITE_P(OfCameras, Prediction, ::testing::ValuesIn(cases()),
                         [](const auto& made) { return made.param.name; });

TEST(StepResponse, OneStepIsOneExponential) {
  Response response;
  const std::vector<Step> steps{{0.0123456, 10.0}};
  const StepResponse table(steps, response);
  EXPECT_EQ(table.at(0.0), 0.0);
  for (const double t : {0.0124, 0.0200001, 0.05, 0.2}) {
    EXPECT_NEAR(table.at(t), 10.0 * (1.0 - std::exp(-(t - 0.0123456) / response.tau_s)), 2e-5) << t;
  }
}

TEST(StepResponse, SeveralStepsAddUp) {
  Response response;
  const std::vector<Step> steps{{0.010001, 3.0}, {0.010004, 4.0}, {0.010011, -2.0}};
  const StepResponse table(steps, response);
  double expected = 0.0;
  for (const Step& s : steps) expected += s.height * (1.0 - std::exp(-(0.03 - s.t_s) / response.tau_s));
  EXPECT_NEAR(table.at(0.03), expected, 1e-5);
}

// Bars whose edges are part Gaussian, part ramp, against numerical integration.
TEST(BarTable, EdgesAreRampsAndGaussians) {
  Bars bars{.period_px = 20.0, .bar_width_px = 8.0, .edge_px2 = 0.04, .ramp_px = 0.7};
  const auto hot = [&](double u) {  // the Gaussian part by its distribution function
    double share = 0.0;
    for (const double from : {-20.0, 0.0, 20.0}) {
      share += 0.5 * (std::erf((u - from) / std::sqrt(0.08)) - std::erf((u - from - 8.0) / std::sqrt(0.08)));
    }
    return share;
  };
  constexpr int kParts = 40;
  const auto place = [](int i, double width) { return ((i + 0.5) / kParts - 0.5) * width; };
  for (const double velocity : {0.0, 1e-3}) {
    bars.velocity_px_s = velocity;
    const BarTable table(BarShape(bars, 0.0), {});
    for (const double phase : {-0.7, -0.2, 0.1, 0.9, 4.0, 7.6, 8.3, 12.0}) {
      double mean = 0.0;
      for (int i = 0; i < kParts; ++i) {
        for (int j = 0; j < kParts; ++j) mean += hot(phase + place(i, 1.0) + place(j, 0.7));
      }
      EXPECT_NEAR(table.at(phase), mean / std::pow(kParts, 2), 2e-4) << velocity << " px/s at " << phase;
    }
  }
}

// Planck's law over the band by Simpson's rule, with ten times the resolution of the table.
double band_radiance(double temperature_k) {
  constexpr int kParts = 640;
  constexpr double kWidth = (14e-6 - 7.5e-6) / kParts;
  double sum = 0.0;
  for (int i = 0; i <= kParts; ++i) {
    const double um = 7.5e-6 + kWidth * i;
    const double weight = i == 0 || i == kParts ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
    sum += weight / (std::pow(um * 1e5, 5.0) * std::expm1(0.014387768775 / (um * temperature_k)));
  }
  return sum * kWidth / 3.0;
}

TEST(BandSignal, FollowsPlancksLawInKelvinOfItsOwn) {
  const double slope = (band_radiance(300.01) - band_radiance(299.99)) / 0.02;
  for (const double t : {230.0, 273.15, 290.03, 300.0, 319.87, 350.0, 420.0}) {
    const double expected = 300.0 + (band_radiance(t) - band_radiance(300.0)) / slope;
    EXPECT_NEAR(band_signal(t), expected, 2e-4 * std::max(1.0, std::abs(t - 300.0))) << t;
  }
  EXPECT_NEAR(band_signal(300.0), 300.0, 1e-6);
}

TEST(BandSignal, RisesAndBendsUpwards) {
  for (double t = 210.0; t < 600.0; t += 7.3) {
    const double below = band_signal(t) - band_signal(t - 1.0);
    const double above = band_signal(t + 1.0) - band_signal(t);
    EXPECT_GT(below, 0.0) << t;
    EXPECT_GT(above, below) << t;
  }
}

TEST(BandTemperature, UndoesBandSignal) {
  for (double t = 205.0; t < 650.0; t += 3.7) EXPECT_NEAR(band_temperature(band_signal(t)), t, 1e-5) << t;
}

TEST(MixedTemperature, UndoesMixedSignalForEveryShare) {
  for (const double share : {0.0, 0.3, 1.0, 1.5}) {
    for (double t = 260.0; t < 400.0; t += 13.7) {
      EXPECT_NEAR(mixed_temperature(mixed_signal(t, share), share), t, 1e-5) << share << " " << t;
    }
  }
  EXPECT_EQ(mixed_signal(333.3, 0.0), 333.3);
  EXPECT_NEAR(mixed_signal(333.3, 1.0), band_signal(333.3), 1e-9);
}

TEST(TemperatureTable, IsOffByLessThanTwentyMicrokelvinAndFiniteForASingleValue) {
  const double low = mixed_signal(290.0, 1.0);
  const double high = mixed_signal(330.0, 1.0);
  const TemperatureTable table(1.0, low, high);
  for (double s = low; s <= high; s += 0.0317) EXPECT_NEAR(table.at(s), mixed_temperature(s, 1.0), 20e-6) << s;
  EXPECT_NEAR(TemperatureTable(1.0, 300.0, 300.0).at(300.0), 300.0, 1e-3);
}

}  // namespace bolo::diagnose::response_test
