// Each correction against an independent double-precision model of its effect.
#include "src/corrections/chain.hpp"
#include "src/model/bolometer.hpp"
#include "tests/motion/scenes.hpp"
#include "tests/refusal.hpp"

namespace bolo::corrections::chain_test {

constexpr Geometry kSmall{24, 16};
constexpr double kTau = 0.011;
constexpr double kPeriod = 0.005;
constexpr double kRounding = 0.02;  // float rounding at 30,000 counts of K / 100: 0.2 mK

using Frames = std::vector<std::vector<double>>;

StreamFormat in_counts(Geometry geometry) { return {.geometry = geometry}; }
StreamFormat floats(Geometry geometry = kSmall) { return {.geometry = geometry, .type = PixelType::kFloat32}; }

std::unique_ptr<Chain> make(const model::Undo& undo, const StreamFormat& format = floats()) {
  return *must(Chain::create({undo, {}, {}, 0.03}, format, 4));
}

// Counts of a scene: an independent random walk in each pixel.
Frames walks(std::size_t frames, double step, Geometry geometry = kSmall) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  Frames all(frames, std::vector<double>(geometry.pixels(), 30'000.0));
  for (std::size_t k = 1; k < frames; ++k) {
    for (std::size_t p = 0; p < geometry.pixels(); ++p) all[k][p] = all[k - 1][p] + step * normal(random);
  }
  return all;
}

struct Passed {
  std::vector<std::uint64_t> ids;
  Frames planes;
};

Passed pass(Chain& chain, const Frames& frames, const std::vector<std::uint64_t>& ids) {
  Passed passed{ids, {}};
  const std::size_t pixels = chain.format().geometry.pixels();
  std::vector<float> raw(pixels);
  for (const std::uint64_t id : ids) {
    for (std::size_t p = 0; p < pixels; ++p) raw[p] = static_cast<float>(frames[id][p]);
    FrameMeta meta;
    meta.frame_id = id;
    chain.begin(meta, raw.data(), false);
    for (std::size_t p = 0; p < chain.passes(); ++p) {
      chain.begin_pass(p);
      chain.apply(p, {0, pixels / (p + 2)});
      chain.apply(p, {pixels / (p + 2), pixels});
    }
    chain.finish();
    const auto* const plane = static_cast<const float*>(chain.plane());
    passed.planes.emplace_back(plane, plane + pixels);
  }
  return passed;
}

std::vector<std::uint64_t> all_of(const Frames& frames) {
  std::vector<std::uint64_t> ids;
  for (std::size_t k = 0; k < frames.size(); ++k) ids.push_back(k);
  return ids;
}

double worst(const Passed& passed, const Frames& wanted, std::size_t from = 0) {
  double most = 0.0;
  for (std::size_t i = from; i < passed.ids.size(); ++i) {
    for (std::size_t p = 0; p < wanted.front().size(); ++p) {
      most = std::max(most, std::abs(passed.planes[i][p] - wanted[passed.ids[i]][p]));
    }
  }
  return most;
}

// Temporal filter: each frame mixed with the previous input, or, if recursive, the previous output.
Frames filtered(const Frames& x, double weight, bool recursive) {
  Frames y = x;
  for (std::size_t k = 1; k < x.size(); ++k) {
    const std::vector<double>& before = (recursive ? y : x)[k - 1];
    for (std::size_t p = 0; p < x[k].size(); ++p) y[k][p] = weight * x[k][p] + (1.0 - weight) * before[p];
  }
  return y;
}

TEST(Corrections, ChangesNothingByDefault) {
  const auto chain = make({});
  EXPECT_FALSE(chain->before());
  EXPECT_FALSE(chain->after());
  EXPECT_EQ(chain->format(), floats());
  const auto counts = make({}, in_counts(kSmall));
  EXPECT_EQ(counts->format().type, PixelType::kUint16) << "the solver gets the frames as they came";
}

TEST(Corrections, AFilterIsInverted) {
  const Frames x = walks(60, 40.0);
  for (const double weight : {0.3, 0.6, 0.9}) {
    const auto recursive = make({.filter = model::FrameFilter::kRecursive, .filter_weight = weight});
    EXPECT_LT(worst(pass(*recursive, filtered(x, weight, true), all_of(x)), x), kRounding / weight) << weight;
    if (weight < 0.5) continue;
    const auto box = make({.filter = model::FrameFilter::kBox, .filter_weight = weight});
    EXPECT_LT(worst(pass(*box, filtered(x, weight, false), all_of(x)), x), 5.0 * kRounding) << weight;
  }
}

TEST(Corrections, AFilterMeetsALostFrameOnALine) {
  Frames x(40, std::vector<double>(kSmall.pixels()));
  for (std::size_t k = 0; k < x.size(); ++k) std::ranges::fill(x[k], 30'000.0 + 12.0 * static_cast<double>(k));
  const auto chain = make({.filter = model::FrameFilter::kRecursive, .filter_weight = 0.6});
  std::vector<std::uint64_t> ids = all_of(x);
  ids.erase(ids.begin() + 30, ids.begin() + 33);
  EXPECT_LT(worst(pass(*chain, filtered(x, 0.6, true), ids), x), kRounding);
}

TEST(Corrections, ASlowPoleIsTakenOut) {
  constexpr double kShare = 0.03;
  constexpr double kSlowTau = 0.2;
  const Frames input = walks(400, 30.0);
  Frames fast = input;
  Frames shown = input;
  Frames slow = input;
  const double p = std::exp(-kPeriod / kTau);
  const double q = std::exp(-kPeriod / kSlowTau);
  for (std::size_t k = 1; k < input.size(); ++k) {
    for (std::size_t i = 0; i < kSmall.pixels(); ++i) {
      fast[k][i] = p * fast[k - 1][i] + (1.0 - p) * input[k][i];
      slow[k][i] = q * slow[k - 1][i] + (1.0 - q) * input[k][i];
      shown[k][i] = (1.0 - kShare) * fast[k][i] + kShare * slow[k][i];
    }
  }
  const auto chain = make({.slow_share = kShare, .slow_tau_s = kSlowTau});
  EXPECT_LT(worst(pass(*chain, shown, all_of(shown)), fast), 10.0 * kRounding);
}

// RMS of each frame's mean error.
double common_rms(const Frames& seen, const Frames& wanted, std::size_t from) {
  double squares = 0.0;
  for (std::size_t k = from; k < seen.size(); ++k) {
    double mean = 0.0;
    for (std::size_t p = 0; p < seen[k].size(); ++p) {
      mean += (seen[k][p] - wanted[k][p]) / static_cast<double>(seen[k].size());
    }
    squares += mean * mean / static_cast<double>(seen.size() - from);
  }
  return std::sqrt(squares);
}

constexpr Geometry kPicture{96, 48};

// Moving edges in counts with noise of 3. With `slopes` no pixel is still.
Frames moving_scene(std::size_t frames, double slopes = 0.0) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 3.0);
  Frames all(frames, std::vector<double>(kPicture.pixels()));
  for (std::size_t k = 0; k < frames; ++k) {
    for (std::size_t p = 0; p < all[k].size(); ++p) {
      const double x = static_cast<double>(p % 96) - 0.7 * static_cast<double>(k);
      all[k][p] = 30'000.0 + slopes * std::sin(0.196 * x) + 200.0 * std::tanh(8.0 * std::sin(0.2 * x)) + noise(random);
    }
  }
  return all;
}

TEST(Corrections, FlickerIsTakenOutOfAMovingScene) {
  const Frames scene = moving_scene(200);
  Frames seen = scene;
  std::mt19937 random(5);
  std::normal_distribution<double> flicker(0.0, 4.0);  // 40 mK
  for (auto& frame : seen) {
    const double offset = flicker(random);
    for (double& value : frame) value += offset;
  }
  const auto chain = make({.flicker_k = 0.04}, floats(kPicture));
  const Passed passed = pass(*chain, seen, all_of(seen));
  const double before = common_rms(seen, scene, 20);
  EXPECT_LT(common_rms(passed.planes, scene, 20), 0.5 * before) << "of " << before << " counts";
}

TEST(Corrections, FlickerIsLeftWhereEverythingMoves) {
  const Frames scene = moving_scene(200, 300.0);
  const auto chain = make({.flicker_k = 0.04}, floats(kPicture));
  EXPECT_LT(common_rms(pass(*chain, scene, all_of(scene)).planes, scene, 20), 0.5) << "counts; nothing is invented";
}

TEST(Corrections, AJumpIsFollowedAndMotionIsNot) {
  const Frames scene = moving_scene(120);
  Frames seen = scene;
  for (std::size_t k = 60; k < seen.size(); ++k) {
    for (double& value : seen[k]) value += 150.0;
  }
  const auto chain = make({.follow_jumps = true}, floats(kPicture));
  EXPECT_LT(worst(pass(*chain, scene, all_of(scene)), scene), kRounding);
  const auto again = make({.follow_jumps = true}, floats(kPicture));
  EXPECT_LT(worst(pass(*again, seen, all_of(seen)), scene), 5.0) << "what moves shifts the centre a little";
  const Frames wild = moving_scene(120, 300.0);
  const auto third = make({.follow_jumps = true}, floats(kPicture));
  EXPECT_LT(worst(pass(*third, wild, all_of(wild)), wild), kRounding) << "nothing is invented";
}

TEST(Corrections, AFalseJumpIsForgotten) {
  Frames seen = moving_scene(120);
  for (std::size_t k = 0; k < 40; ++k) {
    for (std::size_t p = 0; p < seen[k].size(); ++p) seen[k][p] = (p + k) % 2 == 0 ? 0.0 : 65535.0;
  }
  const auto chain = make({.follow_jumps = true}, floats(kPicture));
  EXPECT_LT(worst(pass(*chain, seen, all_of(seen)), seen, 40), kRounding) << "no camera jumps so far";
  constexpr Geometry kTiny{4, 3};
  Frames long_after(30'000, std::vector<double>(kTiny.pixels(), 30'000.0));  // 150 s
  for (std::size_t k = 10; k < long_after.size(); ++k) std::ranges::fill(long_after[k], 30'150.0);
  const Passed passed = pass(*make({.follow_jumps = true}, floats(kTiny)), long_after, all_of(long_after));
  EXPECT_NEAR(passed.planes[20].front(), 30'000.0, 5.0);
  EXPECT_NEAR(passed.planes.back().front(), 30'150.0, 15.0);
}

TEST(Corrections, CurvesOfRadianceAndEmissivityAreInverted) {
  const model::Undo undo{.radiance = true, .emissivity = 0.95, .reflected_k = 290.0};
  const auto made = make(undo);
  Frames shown(1, std::vector<double>(kSmall.pixels()));
  std::vector<double> real;
  for (std::size_t p = 0; p < kSmall.pixels(); ++p) {
    real.push_back(250.0 + 0.3 * static_cast<double>(p));
    const double mixed = 0.95 * model::band_radiance(real.back()) + 0.05 * model::band_radiance(290.0);
    shown[0][p] = 100.0 * model::band_temperature(mixed);
  }
  const Passed passed = pass(*made, shown, {0});
  std::vector<float> kelvin;
  for (std::size_t p = 0; p < kSmall.pixels(); ++p) kelvin.push_back(static_cast<float>(0.01 * passed.planes[0][p]));
  std::vector<std::uint16_t> counts;
  for (const float k : kelvin) counts.push_back(static_cast<std::uint16_t>(std::lround(100.0F * k)));
  made->restore({PixelType::kFloat32, kelvin.data(), {0, kelvin.size()}, nullptr, 0});
  made->restore({PixelType::kUint16, counts.data(), {0, counts.size()}, nullptr, 0});
  for (std::size_t p = 0; p < kSmall.pixels(); ++p) {
    EXPECT_NEAR(static_cast<double>(kelvin[p]), real[p], 1e-3) << p;
    EXPECT_NEAR(0.01 * counts[p], real[p], 0.0125) << p;
  }
}

// A pixel in equilibrium: y (1 + n c) = x + c sum y_n, on 4 x 3 pixels, one of them dead and replaced by the mean of
// its neighbours.
TEST(Corrections, HeatThatFlowsSidewaysIsGivenBack) {
  constexpr Geometry kTiny{4, 3};
  constexpr double kCoupling = 0.05;
  constexpr std::size_t kDead = 5;
  std::vector<double> x;
  for (int p = 0; p < 12; ++p) x.push_back(300.0 + 7.0 * ((p * 5) % 12));
  std::vector<double> y = x;
  for (int round = 0; round < 200; ++round) {
    y[kDead] = (y[0] + y[1] + y[2] + y[4] + y[6] + y[8] + y[9] + y[10]) / 8.0;
    for (int p = 0; p < 12; ++p) {
      if (p == static_cast<int>(kDead)) continue;
      double sum = x[static_cast<std::size_t>(p)];
      double weight = 1.0;
      for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
        const int column = p % 4 + dx;
        const int row = p / 4 + dy;
        if (column < 0 || column > 3 || row < 0 || row > 2) continue;
        sum += kCoupling * y[static_cast<std::size_t>(row * 4 + column)];
        weight += kCoupling;
      }
      y[static_cast<std::size_t>(p)] = sum / weight;
    }
  }
  model::PixelMaps maps;
  maps.dead.assign(12, 0);
  maps.dead[kDead] = 1;
  maps.offset.assign(12, 0.0F);
  maps.offset[3] = 2.0F;
  for (const PixelType type : {PixelType::kUint16, PixelType::kFloat32}) {
    StreamFormat format = in_counts(kTiny);
    format.type = type;
    const auto made = must(Chain::create({{.coupling = kCoupling}, {}, maps, 0.03}, format, 4));
    Chain& chain = **made;
    ASSERT_TRUE(chain.before());
    std::vector<std::uint16_t> counts;
    std::vector<float> values;
    for (std::size_t p = 0; p < 12; ++p) {
      const double seen = p == kDead ? 0.0 : 100.0 * (y[p] - static_cast<double>(maps.offset[p]));
      counts.push_back(static_cast<std::uint16_t>(std::lround(seen)));
      values.push_back(static_cast<float>(seen));
    }
    chain.begin({}, type == PixelType::kUint16 ? static_cast<const void*>(counts.data()) : values.data(), true);
    chain.apply(0, {0, 12});
    chain.finish();
    const auto* const corrected = static_cast<const float*>(chain.plane());
    std::vector<float> solved;  // solver output for a still scene
    for (std::size_t p = 0; p < 12; ++p) {
      EXPECT_NEAR(static_cast<double>(corrected[p]), 100.0 * y[p], 0.6) << p;
      solved.push_back(0.01F * corrected[p]);
    }
    chain.restore({PixelType::kFloat32, solved.data(), {0, 5}, chain.plane(), 0});
    chain.restore({PixelType::kFloat32, solved.data(), {5, 12}, chain.plane(), 5});
    for (std::size_t p = 0; p < 12; ++p) {
      if (p == kDead) continue;
      EXPECT_NEAR(static_cast<double>(solved[p]), x[p], 0.01) << p;
    }
  }
}

TEST(Corrections, APatternThatStaysWhileTheSceneMovesIsTakenOut) {
  const motion::testing::Texture texture(3, 300.0);
  Frames scene(80, std::vector<double>(kPicture.pixels()));
  for (std::size_t k = 0; k < scene.size(); ++k) {
    for (std::size_t p = 0; p < kPicture.pixels(); ++p) {
      const double x = static_cast<double>(p % 96) - 1.7 * static_cast<double>(k);
      const double y = static_cast<double>(p / 96) - 0.9 * static_cast<double>(k);
      scene[k][p] = 30'000.0 + texture(x, y);
    }
  }
  Frames seen = scene;
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0.0, 8.0);
  for (std::size_t p = 0; p < kPicture.pixels(); ++p) {
    const double offset = normal(random);
    for (auto& frame : seen) frame[p] += offset;
  }
  const auto left = [&](Chain& chain) {  // RMS error of the last frame
    const Passed passed = pass(chain, seen, all_of(seen));
    double squares = 0.0;
    for (std::size_t p = 0; p < kPicture.pixels(); ++p) {
      const double e = passed.planes.back()[p] - scene.back()[p];
      squares += e * e / static_cast<double>(kPicture.pixels());
    }
    return std::sqrt(squares);
  };
  const auto chain = make({.scene_nuc = true}, floats(kPicture));
  EXPECT_TRUE(chain->beyond_maps());
  EXPECT_LT(left(*chain), 0.6 * 8.0);
  FrameMeta later;
  later.frame_id = 1'000;
  std::vector<float> raw(kPicture.pixels(), 30'000.0F);
  chain->begin(later, raw.data(), true);
  for (std::size_t p = 0; p < chain->passes(); ++p) {
    chain->begin_pass(p);
    chain->apply(p, {0, kPicture.pixels()});
  }
  EXPECT_EQ(std::memcmp(chain->plane(), raw.data(), raw.size() * sizeof(float)), 0) << "after a NUC all is new";
}

TEST(Corrections, MapsOfAnotherSizeAreRefused) {
  model::PixelMaps maps;
  maps.gain.assign(7, 1.0F);
  expect_refused(Chain::create({{}, {}, maps, 0.03}, floats(), 4), {"7"});
}

TEST(Corrections, TemperaturesAreNeededForCurves) {
  StreamFormat counts = floats();
  counts.scale.unit = Unit::kCount;
  expect_refused(Chain::create({{.emissivity = 0.9}, {}, {}, 3.0}, counts, 4), {});
  EXPECT_TRUE(Chain::create({{.flicker_k = 2.0}, {}, {}, 3.0}, counts, 4));
}

TEST(Corrections, ValuesAtTheCeilingAreTold) {
  const auto made = make({.ceiling_k = 310.0}, in_counts({4, 1}));
  const std::vector<std::uint16_t> below{30'000, 30'998, 30'999, 200};
  const std::vector<std::uint16_t> there{30'000, 31'000, 30'999, 200};
  EXPECT_FALSE(made->saturated(below.data(), {0, 4}));
  EXPECT_TRUE(made->saturated(there.data(), {0, 4}));
  EXPECT_FALSE(made->saturated(there.data(), {2, 4}));
}

}  // namespace bolo::corrections::chain_test
