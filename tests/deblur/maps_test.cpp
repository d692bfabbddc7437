// Corrections of single pixels: gain and offset, time constants of their own, dead pixels.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "bolo/deblur/solver.hpp"
#include "src/deblur/correction.hpp"
#include "src/deblur/kernels.hpp"
#include "src/deblur/samples.hpp"
#include "tests/deblur/inputs.hpp"

namespace bolo::deblur {
namespace {

using testing::Input;
using testing::InputSource;

constexpr Geometry kFrame{37, 23};

StreamFormat counts_of_10_mk(Geometry geometry) {
  StreamFormat format;
  format.geometry = geometry;
  return format;
}

StreamFormat float_kelvin(Geometry geometry) {
  StreamFormat format = counts_of_10_mk(geometry);
  format.type = PixelType::kFloat32;
  format.scale = {Unit::kKelvin, 1.0, 0.0};
  return format;
}

// A window of uint16 planes, or the same as float kelvin.
class Window16 {
 public:
  Window16(const Settings& settings, Geometry geometry, std::uint32_t seed) : settings_(settings) {
    counts_.assign(static_cast<std::size_t>(settings.window), std::vector<std::uint16_t>(geometry.pixels()));
    InputSource source(settings.window, settings.period_s / settings.tau_s, seed);
    for (std::size_t pixel = 0; pixel < geometry.pixels(); ++pixel) {
      const std::vector<double> y = source.pixel(Input::kPan);
      for (std::size_t slot = 0; slot < y.size(); ++slot) {
        counts_[slot][pixel] = static_cast<std::uint16_t>(std::lround(y[slot] * 100.0));
      }
    }
    for (const auto& plane : counts_) {
      kelvin_.emplace_back(plane.size());
      for (std::size_t i = 0; i < plane.size(); ++i) kelvin_.back()[i] = 0.01F * static_cast<float>(plane[i]);
      pointers_[0].push_back(plane.data());
    }
    for (const auto& plane : kelvin_) pointers_[1].push_back(plane.data());
  }
  Window16(const Window16&) = delete;
  Window16& operator=(const Window16&) = delete;

  void lose(std::size_t slot) { pointers_[0][slot] = pointers_[1][slot] = nullptr; }
  WindowView view(PixelType type) const {
    return {pointers_[type == PixelType::kUint16 ? 0 : 1], settings_.window - 1 - settings_.lookahead};
  }

 private:
  Settings settings_;
  std::vector<std::vector<std::uint16_t>> counts_;
  std::vector<std::vector<float>> kelvin_;
  std::vector<const void*> pointers_[2];
};

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

std::unique_ptr<Solver> make(const Settings& settings, const StreamFormat& format, const model::PixelMaps& maps) {
  auto solver = Solver::create(settings, format, PixelType::kFloat32, maps);
  EXPECT_TRUE(solver) << solver.error().message;
  return solver ? std::move(*solver) : nullptr;
}

std::vector<float> solve_all(Solver& solver, const WindowView& view, Geometry geometry) {
  std::vector<float> out(geometry.pixels(), -1.0F);
  solver.prepare(view);
  solver.solve(view, {0, 0, geometry.width, geometry.height}, out.data());
  return out;
}

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

class Maps : public ::testing::TestWithParam<Method> {
 protected:
  Settings settings(int lookahead = 0) const {
    Settings s;
    s.method = GetParam();
    s.lookahead = lookahead;
    return s;
  }
};

TEST_P(Maps, ThatSayNothingChangeNoBit) {
  const Settings s = settings();
  const Window16 window(s, kFrame, 3U);
  model::PixelMaps maps;
  maps.tau_s.assign(kFrame.pixels(), static_cast<float>(s.tau_s));
  maps.gain.assign(kFrame.pixels(), 1.0F);
  maps.offset.assign(kFrame.pixels(), 0.0F);
  maps.dead.assign(kFrame.pixels(), 0);
  Settings of_map = s;
  of_map.tau_s = static_cast<double>(static_cast<float>(s.tau_s));
  const WindowView view = window.view(PixelType::kUint16);
  const auto plain = make(of_map, counts_of_10_mk(kFrame), {});
  const auto mapped = make(of_map, counts_of_10_mk(kFrame), maps);
  EXPECT_TRUE(same_bits(solve_all(*plain, view, kFrame), solve_all(*mapped, view, kFrame)));
}

TEST_P(Maps, PartsAndPointsAreTheWholeFramesBits) {
  for (const PixelType type : {PixelType::kUint16, PixelType::kFloat32}) {
    for (const bool gap : {false, true}) {
      for (const int lookahead : {0, 1}) {
        const Settings s = settings(lookahead);
        Window16 window(s, kFrame, 5U);
        if (gap) window.lose(9);
        const auto format = type == PixelType::kUint16 ? counts_of_10_mk(kFrame) : float_kelvin(kFrame);
        const auto solver = make(s, format, scattered_maps(kFrame, 0.2));
        const WindowView view = window.view(type);
        const std::vector<float> whole = solve_all(*solver, view, kFrame);

        std::vector<float> in_parts(kFrame.pixels(), -1.0F);
        for (const Region& part : {Region{0, 0, 37, 1}, Region{0, 1, 5, 22}, Region{5, 1, 32, 7}, Region{5, 8, 1, 15},
                                   Region{6, 8, 31, 15}}) {
          solver->solve(view, part, in_parts.data());
        }
        EXPECT_TRUE(same_bits(in_parts, whole)) << gap << lookahead;

        std::vector<std::uint32_t> pixels(kFrame.pixels());
        std::iota(pixels.begin(), pixels.end(), 0U);
        std::shuffle(pixels.begin(), pixels.end(), std::mt19937(1U));
        std::vector<float> points(pixels.size());
        solver->solve_points(view, pixels, points.data());
        for (std::size_t i = 0; i < pixels.size(); ++i) EXPECT_EQ(points[i], whole[pixels[i]]) << pixels[i];
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Solver, Maps, ::testing::Values(Method::kAdmm, Method::kExact, Method::kInverse),
                         [](const auto& each) { return std::string(name(each.param)); });

// A pixel's samples with equalisation, and how often a slot was lost before.
std::vector<double> response(const std::vector<double>& input, double decay, double start) {
  std::vector<double> y{start};
  for (const double x : input) y.push_back(decay * y.back() + (1.0 - decay) * x);
  return y;
}

// The samples of a pixel of another tau become those that the nominal one gives for the same input.
TEST(Correction, EqualisesTimeConstantsOverGaps) {
  for (const double factor : {0.8, 0.95, 1.05, 1.2, 3.0}) {
    for (const bool gap : {false, true}) {
      Settings s;
      const StreamFormat format = float_kelvin({1, 1});
      model::PixelMaps maps;
      maps.tau_s = {static_cast<float>(s.tau_s * factor)};
      const auto correction = Correction::create(s, format, maps);
      ASSERT_TRUE(correction);
      std::vector<double> input;
      for (int i = 0; i < 16; ++i)
        input.push_back(i >= 6 && i < 9 && gap ? input.back() : 300.0 + 25.0 * std::sin(i * i));
      const auto tau = static_cast<double>(maps.tau_s[0]);
      const std::vector<double> measured = response(input, std::exp(-s.period_s / tau), 290.0);
      const std::vector<double> wanted = response(input, std::exp(-s.period_s / s.tau_s), 290.0);
      std::vector<float> samples(measured.begin(), measured.end());
      std::vector<const void*> planes;
      for (const float& sample : samples) planes.push_back(&sample);
      if (gap) planes[6] = planes[7] = planes[8] = nullptr;
      const WindowView view{planes, 16};
      const Pattern pattern = pattern_of(view);
      SampleBlock block(*correction);
      block.read(view, pattern, 0, 1);
      for (std::size_t slot = 0; slot < 17; ++slot) {
        if (!pattern.received[slot]) continue;
        EXPECT_NEAR(static_cast<double>(block.slot(slot)[0]), wanted[slot], 4e-4)
            << factor << " " << gap << " " << slot;
      }
    }
  }
}

TEST(Correction, GainAndOffsetAreOfTheTemperature) {
  Settings s;
  StreamFormat format = counts_of_10_mk({2, 1});
  format.scale = {Unit::kKelvin, 0.04, 200.0};
  model::PixelMaps maps;
  maps.gain = {1.0F, 1.1F};
  maps.offset = {0.5F, -20.0F};
  const auto correction = Correction::create(s, format, maps);
  ASSERT_TRUE(correction);
  const std::vector<std::uint16_t> plane{2500, 2500};  // 300 K
  const std::vector<const void*> planes(17, plane.data());
  const WindowView view{planes, 16};
  SampleBlock block(*correction);
  block.read(view, pattern_of(view), 0, 2);
  for (std::size_t slot = 0; slot < 17; ++slot) {
    EXPECT_NEAR(static_cast<double>(block.slot(slot)[0]) * 0.04 + 200.0, 300.5, 1e-3);
    EXPECT_NEAR(static_cast<double>(block.slot(slot)[1]) * 0.04 + 200.0, 310.0, 1e-3);
  }
}

// The inverse filter is linear: a filled pixel is the mean of what its neighbours become.
TEST(Correction, FillsDeadPixelsFromGoodNeighbours) {
  Settings s;
  s.method = Method::kInverse;
  const Window16 window(s, {7, 7}, 9U);
  model::PixelMaps maps = scattered_maps({7, 7}, 0.2);
  maps.dead.assign(49, 0);
  maps.dead[0] = 1;                // a corner
  for (const int y : {2, 3, 4}) {  // a hole whose middle has only dead neighbours
    for (const int x : {2, 3, 4}) maps.dead[static_cast<std::size_t>(7 * y + x)] = 1;
  }
  const auto solver = make(s, counts_of_10_mk({7, 7}), maps);
  const std::vector<float> out = solve_all(*solver, window.view(PixelType::kUint16), {7, 7});
  const auto mean = [&](std::initializer_list<std::size_t> pixels) {
    double sum = 0.0;
    for (const std::size_t p : pixels) sum += static_cast<double>(out[p]);
    return sum / static_cast<double>(pixels.size());
  };
  EXPECT_NEAR(static_cast<double>(out[0]), mean({1, 7, 8}), 1e-3);
  EXPECT_NEAR(static_cast<double>(out[16]), mean({8, 9, 10, 15, 22}), 1e-3);
  EXPECT_NEAR(static_cast<double>(out[24]), mean({8, 9, 10, 11, 12, 15, 19, 22, 26, 29, 33, 36, 37, 38, 39, 40}), 1e-3);
}

// What is lost by solving equalised samples with the nominal tau: the prior then weighs the input as it is, but the
// residuals as the nominal pixel's. Against the exact optimum with the pixel's own tau, pan with 0.03 K of noise.
class TauSpread : public ::testing::TestWithParam<double> {};

TEST_P(TauSpread, CostsLittle) {
  const double spread = GetParam();
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
    const Window16 window(own, geometry, 21U);
    const WindowView view = window.view(PixelType::kFloat32);
    const std::vector<float> wanted = solve_all(*make(own, float_kelvin(geometry), {}), view, geometry);
    const std::vector<float> got = solve_all(*make(nominal, float_kelvin(geometry), maps), view, geometry);
    for (std::size_t i = 0; i < wanted.size(); ++i, ++count) {
      const double error = static_cast<double>(got[i]) - static_cast<double>(wanted[i]);
      squares += error * error;
      largest = std::max(largest, std::abs(error));
    }
  }
  const double rms = std::sqrt(squares / count);
  std::printf("tau +-%g %%: %.4f K rms, %.4f K at most\n", spread * 100.0, rms, largest);
  RecordProperty("rms_k", std::to_string(rms));
  EXPECT_LT(rms, 0.4 * spread);  // K: 0.02 for 5 %, 0.08 for 20 %
  EXPECT_LT(largest, 0.8 * spread);
}

INSTANTIATE_TEST_SUITE_P(Correction, TauSpread, ::testing::Values(0.05, 0.2),
                         [](const auto& each) { return std::to_string(std::lround(100.0 * each.param)); });

struct Wrong {
  const char* what;
  void (*change)(model::PixelMaps&);
  const char* named;
};
class WrongMaps : public ::testing::TestWithParam<Wrong> {};

TEST_P(WrongMaps, AreRefusedByName) {
  model::PixelMaps maps = scattered_maps(kFrame, 0.1);
  GetParam().change(maps);
  const auto solver = Solver::create(Settings(), counts_of_10_mk(kFrame), PixelType::kFloat32, maps);
  ASSERT_FALSE(solver);
  EXPECT_EQ(solver.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(solver.error().message.find(GetParam().named), std::string::npos) << solver.error().message;
}

INSTANTIATE_TEST_SUITE_P(
    Solver, WrongMaps,
    ::testing::Values(Wrong{"size", [](model::PixelMaps& m) { m.gain.pop_back(); },
                            "gain has 850 values, but the stream's frames are 37x23"},
                      Wrong{"tau", [](model::PixelMaps& m) { m.tau_s[38] = 0.0F; }, "tau_s in row 1, column 1 is 0"},
                      Wrong{"nan", [](model::PixelMaps& m) { m.offset[2] = std::numeric_limits<float>::quiet_NaN(); },
                            "offset in row 0"},
                      Wrong{"gain", [](model::PixelMaps& m) { m.gain[0] = -1.0F; }, "gain"},
                      Wrong{"flag", [](model::PixelMaps& m) { m.dead[0] = 2; }, "dead"},
                      Wrong{"all", [](model::PixelMaps& m) { m.dead.assign(m.dead.size(), 1); }, "every pixel is dead"},
                      Wrong{"delay", [](model::PixelMaps& m) { m.row_delay_s = 0.01; }, "row_delay_s"}),
    [](const auto& each) { return std::string(each.param.what); });

}  // namespace
}  // namespace bolo::deblur
