// The catalogues of simulator and diagnosis, made from two folders, list the same effects; and the selection of
// effects.
#include "src/diagnose/effect.hpp"
#include "src/diagnose/fit.hpp"
#include "src/sim/effect.hpp"
#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::catalogue_test {

TEST(Catalogue, IsTheSimulatorsWithItsStages) {
  std::set<std::string> simulated;
  for (const sim::EffectDescription& effect : sim::effect_descriptions()) {
    if (effect.in_catalogue) simulated.insert(effect.name.data());
  }
  std::set<std::string> names;
  for (const Effect& effect : catalogue()) {
    EXPECT_TRUE(names.insert(effect.name).second) << effect.name;
    EXPECT_EQ(find_effect(effect.name), &effect);
    const sim::EffectDescription* same = sim::find_effect(effect.name);
    ASSERT_NE(same, nullptr) << effect.name;
    EXPECT_EQ(effect.stage, sim::name_of(same->stage)) << effect.name;
    EXPECT_FALSE(effect.words.title.empty()) << effect.name;
    EXPECT_FALSE(effect.words.plain.empty()) << effect.name;
  }
  EXPECT_EQ(names, simulated);
  EXPECT_TRUE(std::ranges::is_sorted(catalogue(), {}, &Effect::name));
  for (const char* none : {"tau_globl", ""}) EXPECT_EQ(find_effect(none), nullptr);
}

// A bench with the captures that any effect needs.
const Session& bench() {
  const sim::CameraSettings camera = testing::noisy_camera();
  static const Session full = testing::session_of(
      {testing::record(camera, capture::Uniform{300.0}, 24), testing::record(camera, capture::Uniform{325.0}, 24),
       testing::record(camera, testing::odd_chopper(), 24), testing::record(camera, testing::slanted_bars(70.0), 24),
       testing::record(camera, testing::slanted_bars(-320.0), 24),
       testing::record(camera, testing::slanted_bars(0.0), 24)});
  return full;
}

// The nominal camera, with the first form of the effect.
State nominal(const Effect& effect) {
  State state = nominal_state(bench(), {});
  if (!effect.forms.empty()) effect.forms.front()(state);
  return state;
}

std::vector<Parameter> parameters_of(const Effect& effect) { return effect.parameters(bench()); }

TEST(Catalogue, EveryEffectIsToldByAFullBenchAndSaysWhatItNeeds) {
  const Session& full = bench();
  const Session nothing = testing::session_of({});
  for (const Effect& effect : catalogue()) {
    ASSERT_TRUE(effect.testable_in) << effect.name;
    EXPECT_TRUE(effect.testable_in(full)) << effect.name;
    EXPECT_FALSE(effect.needs.empty()) << effect.name;
    static_cast<void>(effect.testable_in(nothing));  // either value, without a crash
  }
}

TEST(Catalogue, ParametersReadBackWhatTheyWereSetTo) {
  for (const Effect& effect : catalogue()) {
    State state = nominal(effect);
    const auto parameters = parameters_of(effect);
    if (!parameters.empty()) {
      EXPECT_NEAR(parameters.front().get(state), 0.0, 1e-12) << effect.name << " is nominal";
    }
    for (const Parameter& c : parameters) {
      const std::string what = effect.name + " " + c.name;
      EXPECT_LE(c.low, 0.0) << what;
      EXPECT_GT(c.high, c.step) << what;
      c.set(state, c.step);
      EXPECT_NEAR(c.get(state), c.step, 1e-9) << what;
    }
  }
}

TEST(Catalogue, AnEffectAtItsTypicalSizeChangesThePrediction) {
  const Session& full = bench();
  std::vector<int> pixels;
  for (int p = 0; p < full.grid.pixels(); p += 5) pixels.push_back(p);
  for (const Effect& effect : catalogue()) {
    if (parameters_of(effect).empty()) continue;
    State plain = nominal_state(full, {});
    State state = nominal(effect);
    // A reference of gains has an effect only with gains.
    if (effect.map == MapKind::kGain) {
      plain.camera.gain = state.camera.gain = Eigen::VectorXf::Constant(full.grid.pixels(), 0.01F);
    }
    for (const Parameter& c : parameters_of(effect)) c.set(state, c.step);
    double largest = 0.0;
    for (std::size_t i = 0; i < full.recordings.size(); ++i) {
      const Series change = predict(full, i, state, pixels) - predict(full, i, plain, pixels);
      EXPECT_TRUE(change.allFinite()) << effect.name;
      largest = std::max(largest, static_cast<double>(change.cwiseAbs().maxCoeff()));
    }
    EXPECT_GT(largest, 1e-4) << effect.name;
  }
}

// Fits predict only the read-out anew where the signal is said to be the same.
TEST(Catalogue, ASignalThatIsSaidToBeTheSameIs) {
  const Session& full = bench();
  const std::vector<int> pixels{0, 100, 400, 767};
  int same = 0;
  const auto compare = [&](const State& plain, const Parameter& c) {
    State moved = plain;
    c.set(moved, c.get(plain) + c.step);
    for (std::size_t i = 0; i < full.recordings.size(); ++i) {
      if (!same_signal(i, plain, moved)) continue;
      ++same;
      const Series shown = read_out(full, i, moved.camera, pixels, predict_signal(full, i, plain, pixels));
      EXPECT_TRUE(predict(full, i, moved, pixels) == shown) << c.name << ' ' << i;
    }
  };
  State plain = nominal_state(full, {});
  for (const Nuisance& n : nuisances(full, plain)) compare(plain, n.parameter);
  EXPECT_GT(same, 0) << "levels of other recordings";
  same = 0;
  for (const Effect& effect : catalogue()) {
    for (const Parameter& c : parameters_of(effect)) compare(nominal(effect), c);
  }
  EXPECT_GT(same, 0) << "offsets";
  State varied = plain;
  varied.camera.tau = Eigen::VectorXf::Constant(full.grid.pixels(), 0.01F);
  EXPECT_FALSE(same_signal(0, plain, varied));
}

// The keys of the report are those of `bolo simulate --effect`, so that a diagnosis can be simulated.
TEST(Catalogue, ReportsParametersThatTheSimulatorKnows) {
  const Session& full = bench();
  // Drift: a capture does not give the session's amplitude, so the observed change is reported. Non-linearity: its
  // amount is reported, which the simulator does not have.
  const std::set<std::string> own{"drift", "radiometric_nonlinearity"};
  for (const Effect& effect : catalogue()) {
    if (!effect.report || own.contains(effect.name)) continue;
    State state = nominal(effect);
    std::vector<double> value;
    for (const Parameter& c : parameters_of(effect)) {
      value.push_back(c.step);
      c.set(state, c.step);
    }
    const std::vector<double> error(value.size(), 0.01);
    const sim::EffectDescription* same = sim::find_effect(effect.name);
    ASSERT_NE(same, nullptr) << effect.name;
    for (const auto& [key, estimate] : effect.report({full, state, value, error})) {
      const auto known = std::ranges::find(same->parameters, key, &sim::Parameter::key);
      EXPECT_NE(known, same->parameters.end()) << effect.name << " reports " << key;
      EXPECT_LE(estimate.low, estimate.value) << effect.name << " " << key;
      EXPECT_GE(estimate.high, estimate.value) << effect.name << " " << key;
    }
  }
}

TEST(Interval, IsNinetyFivePercentWide) {
  const Estimate e = interval(2.0, 0.5);
  EXPECT_NEAR(e.low, 2.0 - 0.98, 1e-12);
  EXPECT_NEAR(e.high, 2.0 + 0.98, 1e-12);
  const Estimate root = root_interval(0.49, 0.1);
  EXPECT_NEAR(root.value, 0.7, 1e-12);
  EXPECT_NEAR(root.low * root.low, 0.49 - 0.196, 1e-12);
  EXPECT_EQ(root_interval(0.01, 0.1).low, 0.0);
}

TEST(SpreadOf, TellsColumnsFromPixels) {
  const Session full = testing::session_of({});
  Eigen::VectorXf map(full.grid.pixels());
  for (int p = 0; p < full.grid.pixels(); ++p) map[p] = full.grid.column_of(p) % 2 == 0 ? 0.2F : -0.2F;
  const MapSpread columns = spread_of(full, map);
  EXPECT_NEAR(columns.column, 0.2, 1e-3);
  EXPECT_NEAR(columns.pixel, 0.0, 1e-3);
  for (int p = 0; p < full.grid.pixels(); ++p)
    map[p] = (full.grid.column_of(p) + full.grid.row_of(p)) % 2 == 0 ? 0.2F : -0.2F;
  const MapSpread pixels = spread_of(full, map);
  EXPECT_NEAR(pixels.column, 0.0, 1e-3);
  EXPECT_NEAR(pixels.pixel, 0.2, 0.01);
}

// Three pulses; the last ends after 71 frames.
capture::Chopper short_chopper() {
  return {295.0, {0.0837, 0.1794, 0.2931}, {0.0957, 0.2094, 0.3531}, {305.0, 305.0, 305.0}};
}

class Selection : public ::testing::Test {
 protected:
  std::string told(const std::vector<Recording>& recordings) {
    std::vector<std::filesystem::path> files;
    for (const Recording& r : recordings) {
      files.push_back(testing::write(r, scratch_ / (std::to_string(files.size()) + ".h5")));
    }
    return testing::told(testing::diagnosed(files));
  }

 private:
  Scratch scratch_;
};

// A short chopper alone constrains the time constant strongly, but with too few cells to be sure before the rest fits.
TEST_F(Selection, GoesOnWithWhatIsSureBesideALargerEffect) {
  sim::CameraSettings camera = testing::noisy_camera();
  for (const char* effect : {"tau_global:scale=1.1", "vignetting:corner_loss=0.01"}) {
    camera.effects.push_back(*must(sim::parse_effect(effect)));
  }
  EXPECT_EQ(told({testing::record(camera, short_chopper(), 96), testing::record(camera, capture::Uniform{300.0}, 160),
                  testing::record(camera, capture::Uniform{325.0}, 160)}),
            "explained: tau_global vignetting");
}

// A pattern that one capture lacks is not the camera's.
TEST_F(Selection, LeavesAMapByWhichACaptureFitsWorse) {
  std::mt19937 random(4);
  std::normal_distribution<double> unit;
  std::vector<double> pattern(testing::kWidth * testing::kHeight);
  for (double& one : pattern) one = 0.03 * unit(random);
  const auto shutter = [&](double share) {
    return testing::shutter(200, [&, share](int, int row, int column) {
      return share * pattern[static_cast<std::size_t>(row * testing::kWidth + column)] + 0.03 * unit(random);
    });
  };
  EXPECT_EQ(told({shutter(0.0), shutter(1.0), shutter(1.0)}), "unknown_effect:");
}

}  // namespace bolo::diagnose::catalogue_test
