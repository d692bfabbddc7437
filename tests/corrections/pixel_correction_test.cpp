#include "src/corrections/pixel_correction.hpp"
#include "tests/deblur/inputs.hpp"
#include "tests/deblur/solve.hpp"
#include "tests/refusal.hpp"

namespace bolo::corrections::pixel_correction_test {

using deblur::Method;
using deblur::Settings;
using namespace deblur::testing;

constexpr Geometry kFrame{37, 23};

model::PixelMaps scattered_maps(Geometry geometry, double tau_spread) {
  model::PixelMaps maps;
  std::mt19937 random(11U);
  std::uniform_real_distribution<float> unit(-1.0F, 1.0F);
  for (std::size_t i = 0; i < geometry.pixels(); ++i) {
    maps.tau_s.push_back(static_cast<float>(Settings().tau_s * (1.0 + tau_spread * static_cast<double>(unit(random)))));
    maps.gain.push_back(1.0F + 0.02F * unit(random));
    maps.offset.push_back(2.0F * unit(random));
    maps.dead.push_back(unit(random) > 0.98F ? 1 : 0);
  }
  return maps;
}

PixelCorrection make(const model::PixelMaps& maps, Geometry geometry, const Settings& settings = {}) {
  return *must(PixelCorrection::create(settings, kelvin(geometry), maps));
}

using Planes = std::vector<std::vector<float>>;

// Corrects frames one period apart; an empty plane is a lost frame.
Planes correct_all(PixelCorrection& correction, Planes planes) {
  std::uint64_t periods = 0;
  for (auto& plane : planes) {
    if (plane.empty()) {
      ++periods;
      continue;
    }
    correction.begin(periods);
    correction.apply(plane.data(), {0, plane.size()});
    correction.finish(plane.data());
    periods = 1;
  }
  return planes;
}

// A pan over a scene with noise, seen by a camera of time constant `tau_s`.
Planes pan(int frames, double tau_s, Geometry geometry, std::uint32_t seed) {
  Planes planes(static_cast<std::size_t>(frames), std::vector<float>(geometry.pixels()));
  InputSource source(frames, Settings().period_s / tau_s, seed);
  for (std::size_t pixel = 0; pixel < geometry.pixels(); ++pixel) {
    const std::vector<double> y = source.pixel(Input::kPan);
    for (std::size_t slot = 0; slot < y.size(); ++slot) planes[slot][pixel] = static_cast<float>(y[slot]);
  }
  return planes;
}

std::vector<float> solve(const Settings& settings, const Planes& planes, Geometry geometry) {
  const auto solver = deblur::testing::make(settings, kelvin(geometry));
  std::vector<const void*> newest;
  for (auto at = planes.end() - settings.window; at != planes.end(); ++at) newest.push_back(at->data());
  return deblur::testing::whole_frame(*solver, {newest, settings.window - 1}, geometry);
}

TEST(PixelCorrection, MapsThatSayNothingChangeNoBit) {
  Settings settings;
  model::PixelMaps maps;
  EXPECT_FALSE(make(maps, kFrame).changes_samples());
  maps.tau_s.assign(kFrame.pixels(), static_cast<float>(settings.tau_s));
  settings.tau_s = static_cast<double>(maps.tau_s[0]);
  maps.gain.assign(kFrame.pixels(), 1.0F);
  maps.offset.assign(kFrame.pixels(), 0.0F);
  maps.dead.assign(kFrame.pixels(), 0);
  PixelCorrection correction = make(maps, kFrame, settings);
  EXPECT_TRUE(correction.changes_samples());
  const Planes planes = pan(20, settings.tau_s, kFrame, 3U);
  EXPECT_EQ(correct_all(correction, planes), planes);
}

std::vector<double> response(const std::vector<double>& input, double decay, double start) {
  std::vector<double> y{start};
  for (const double x : input) y.push_back(decay * y.back() + (1.0 - decay) * x);
  return y;
}

// Samples of a pixel with another tau become those of the nominal tau for the same input.
TEST(PixelCorrection, EqualisesTimeConstantsOverGaps) {
  for (const double factor : {0.8, 0.95, 1.05, 1.2, 3.0}) {
    for (const bool gap : {false, true}) {
      const Settings s;
      model::PixelMaps maps;
      maps.tau_s = {static_cast<float>(s.tau_s * factor)};
      PixelCorrection correction = make(maps, {1, 1});
      std::vector<double> input;
      for (int i = 0; i < 40; ++i) {
        input.push_back(i >= 6 && i < 9 && gap ? input.back() : 300.0 + 25.0 * std::sin(i * i));
      }
      const auto tau = static_cast<double>(maps.tau_s[0]);
      const std::vector<double> measured = response(input, std::exp(-s.period_s / tau), 290.0);
      const std::vector<double> wanted = response(input, std::exp(-s.period_s / s.tau_s), 290.0);
      Planes planes;
      for (const double sample : measured) planes.push_back({static_cast<float>(sample)});
      if (gap) planes[6] = planes[7] = planes[8] = {};
      const Planes out = correct_all(correction, planes);
      for (std::size_t i = 0; i < out.size(); ++i) {
        if (out[i].empty()) continue;
        EXPECT_NEAR(static_cast<double>(out[i][0]), wanted[i], 4e-4) << factor << " " << gap << " " << i;
      }
    }
  }
}

// The correction's state from frames before the window cancels in the window's first sample, except for the mean that
// the prior uses: thousandths of a kelvin.
TEST(PixelCorrection, WindowsDoNotDependOnWhenItBegan) {
  for (const Method method : {Method::kInverse, Method::kExact}) {
    const Settings settings{.method = method, .lambda = 1e-4};
    const model::PixelMaps maps = scattered_maps(kFrame, 0.2);
    const Planes planes = pan(60, 0.011, kFrame, 17U);
    PixelCorrection early = make(maps, kFrame);
    PixelCorrection late = make(maps, kFrame);
    const std::vector<float> a = solve(settings, correct_all(early, planes), kFrame);
    const std::vector<float> b = solve(settings, correct_all(late, Planes(planes.end() - 17, planes.end())), kFrame);
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 6e-3F) << name(method) << " " << i;
  }
}

TEST(PixelCorrection, BeginsAnewAfterALongBreakAndWhenTold) {
  const model::PixelMaps maps = scattered_maps({3, 1}, 0.2);
  for (const std::uint64_t periods : {std::uint64_t{0}, std::uint64_t{100'000}}) {
    PixelCorrection used = make(maps, {3, 1});
    PixelCorrection fresh = make(maps, {3, 1});
    Planes before{{300.0F, 310.0F, 320.0F}, {350.0F, 300.0F, 310.0F}};
    correct_all(used, before);
    std::vector<float> after{290.0F, 291.0F, 292.0F};
    std::vector<float> wanted = after;
    used.begin(periods);
    used.apply(after.data(), {0, 3});
    fresh.begin(0);
    fresh.apply(wanted.data(), {0, 3});
    EXPECT_EQ(after, wanted) << periods;
  }
}

TEST(PixelCorrection, GainAndOffsetAreOfTheTemperature) {
  StreamFormat format = kelvin({2, 1});
  format.scale = {Unit::kKelvin, 0.04, 200.0};
  model::PixelMaps maps;
  maps.gain = {1.0F, 1.1F};
  maps.offset = {0.5F, -20.0F};
  auto correction = must(PixelCorrection::create(Settings(), format, maps));
  std::vector<float> plane{2500.0F, 2500.0F};  // 300 K
  correction->begin(0);
  correction->apply(plane.data(), {0, 2});
  EXPECT_NEAR(static_cast<double>(plane[0]) * 0.04 + 200.0, 300.5, 1e-3);
  EXPECT_NEAR(static_cast<double>(plane[1]) * 0.04 + 200.0, 310.0, 1e-3);
}

TEST(PixelCorrection, FillsDeadPixelsFromGoodNeighbours) {
  model::PixelMaps maps;
  maps.dead.assign(49, 0);
  maps.dead[0] = 1;                // a corner
  for (const int y : {2, 3, 4}) {  // the centre has only dead neighbours
    for (const int x : {2, 3, 4}) maps.dead[static_cast<std::size_t>(7 * y + x)] = 1;
  }
  PixelCorrection correction = make(maps, {7, 7});
  std::vector<float> plane;
  for (int i = 0; i < 49; ++i) plane.push_back(static_cast<float>(290 + i * i % 31));
  const std::vector<float> out = correct_all(correction, {plane})[0];
  const auto mean = [&](std::initializer_list<std::size_t> pixels) {
    double sum = 0.0;
    for (const std::size_t p : pixels) sum += static_cast<double>(plane[p]);
    return sum / static_cast<double>(pixels.size());
  };
  EXPECT_NEAR(static_cast<double>(out[0]), mean({1, 7, 8}), 1e-4);
  EXPECT_NEAR(static_cast<double>(out[16]), mean({8, 9, 10, 15, 22}), 1e-4);
  EXPECT_NEAR(static_cast<double>(out[24]), mean({8, 9, 10, 11, 12, 15, 19, 22, 26, 29, 33, 36, 37, 38, 39, 40}), 1e-4);
  for (std::size_t i = 0; i < out.size(); ++i) {
    EXPECT_TRUE(maps.dead[i] != 0 || out[i] == plane[i]) << i;
  }
}

// Cost of solving equalised samples with the nominal tau: the prior weighs the right input, but residuals are weighed
// as the nominal pixel's. Reference: exact optimum with the pixel's own tau; pan, 0.03 K of noise.
void expect_little_cost(double spread) {
  SCOPED_TRACE(spread);
  const Geometry geometry{64, 1};
  double squares = 0.0;
  double largest = 0.0;
  int count = 0;
  for (const double factor : {1.0 - spread, 1.0 + spread}) {
    Settings own;
    own.method = Method::kExact;
    own.tau_s *= factor;
    Settings nominal = own;
    nominal.tau_s = Settings().tau_s;
    model::PixelMaps maps;
    maps.tau_s.assign(geometry.pixels(), static_cast<float>(own.tau_s));
    const Planes planes = pan(own.window, own.tau_s, geometry, 21U);
    PixelCorrection correction = make(maps, geometry, nominal);
    const std::vector<float> wanted = solve(own, planes, geometry);
    const std::vector<float> got = solve(nominal, correct_all(correction, planes), geometry);
    for (std::size_t i = 0; i < wanted.size(); ++i, ++count) {
      const double error = static_cast<double>(got[i]) - static_cast<double>(wanted[i]);
      squares += error * error;
      largest = std::max(largest, std::abs(error));
    }
  }
  const double rms = std::sqrt(squares / count);
  std::printf("tau +-%g %%: %.4f K rms, %.4f K at most\n", spread * 100.0, rms, largest);
  EXPECT_LT(rms, 0.4 * spread);  // K: 0.02 for 5 %, 0.08 for 20 %
  EXPECT_LT(largest, 0.8 * spread);
}

TEST(PixelCorrection, SpreadOfTauCostsLittle) {
  for (const double spread : {0.05, 0.2}) expect_little_cost(spread);
}

TEST(PixelCorrection, WrongMapsAreRefusedByName) {
  struct Wrong {
    const char* what;
    void (*change)(model::PixelMaps&);
    const char* named;
  };
  for (const Wrong& wrong : std::initializer_list<Wrong>{
           {"size", [](model::PixelMaps& m) { m.gain.pop_back(); },
            "gain has 850 values, but the stream's frames are 37x23"},
           {"tau", [](model::PixelMaps& m) { m.tau_s[38] = 0.0F; }, "tau_s in row 1, column 1 is 0"},
           {"nan", [](model::PixelMaps& m) { m.offset[2] = std::numeric_limits<float>::quiet_NaN(); },
            "offset in row 0"},
           {"gain", [](model::PixelMaps& m) { m.gain[0] = -1.0F; }, "gain"},
           {"flag", [](model::PixelMaps& m) { m.dead[0] = 2; }, "dead"},
           {"all", [](model::PixelMaps& m) { m.dead.assign(m.dead.size(), 1); }, "every pixel is dead"}}) {
    SCOPED_TRACE(wrong.what);
    model::PixelMaps maps = scattered_maps(kFrame, 0.1);
    wrong.change(maps);
    expect_refused(PixelCorrection::create(Settings(), kelvin(kFrame), maps), {wrong.named});
  }
}

}  // namespace bolo::corrections::pixel_correction_test
