#include <malloc.h>

#include "tests/motion/stream.hpp"

namespace bolo::deblur::solver_test {

using namespace testing;

TEST(MotionSolver, HalvesTheErrorOfPerPixelEstimatesInPans) {
  for (const double speed : {1.5, 3.0, 6.0}) {
    Stream stream(pan(speed, 0.2 * speed), 0.03, 24);
    const double mmae = stream.error(settings_of(Method::kMmae, 0.03), 23);
    const double motion = stream.error(settings_of(Method::kMotion, 0.03), 23);
    EXPECT_LT(motion, 0.5 * mmae) << speed;
    EXPECT_LT(mmae, stream.blurred_error(23)) << speed;
  }
}

// Detail finer than the optics pass is noise, and a steady motion tells where past frames lie.
TEST(MotionSolver, SlowPansAreLittleNoisierThanFrames) {
  for (const auto& [speed, most] : {std::pair{0.2, 0.041}, std::pair{0.5, 0.056}}) {
    Stream stream(pan(speed, 0.2 * speed), 0.03, 26);
    double sum = 0.0;
    for (const int k : {23, 24, 25}) sum += stream.error(settings_of(Method::kMotion, 0.03), k);
    EXPECT_LT(sum / 3.0, most) << speed;
  }
}

// A swing back and forth, and a turn around a corner: with straight trails 0.9 and 0.8 of a per-pixel estimate's error
// would remain.
TEST(MotionSolver, FollowsPathsThatBend) {
  const Texture texture(5, 6.0);
  const Scene swing = [&](double x, double y, double t) { return texture(x - 14.0 * std::sin(0.13 * t), y); };
  const Scene around = [&](double x, double y, double t) {
    return texture(x - 12.0 * std::cos(0.15 * t), y - 12.0 * std::sin(0.15 * t));
  };
  for (const Scene& scene : {swing, around}) {
    Stream stream(scene, 0.03, 40);
    double mmae = 0.0;
    double motion = 0.0;
    for (int k = 24; k < 40; ++k) {
      mmae += std::pow(stream.error(settings_of(Method::kMmae, 0.03), k), 2);
      motion += std::pow(stream.error(settings_of(Method::kMotion, 0.03), k), 2);
    }
    EXPECT_LT(motion, 0.36 * mmae);
  }
}

TEST(MotionSolver, LookaheadIsAheadOfThatOfPerPixelEstimates) {
  Stream stream(pan(3.0, 0.6), 0.1, 26);
  const double late = stream.error(settings_of(Method::kMotion, 0.1, 1), 23);
  EXPECT_LT(late, 0.8 * stream.error(settings_of(Method::kMmae, 0.1, 1), 23));
}

TEST(MotionSolver, StillsAndFlatPicturesAreNotWorseThanMmae) {
  const std::vector<Scene> scenes{pan(0.0, 0.0), [](double, double, double) { return 1.0; }};
  for (const Scene& scene : scenes) {
    for (const double noise : {0.03, 0.5}) {
      Stream stream(scene, noise, 24);
      EXPECT_LT(stream.error(settings_of(Method::kMotion, noise), 23),
                1.03 * stream.error(settings_of(Method::kMmae, noise), 23));
    }
  }
}

// Where a picture at rest has no contrast, neighbours average out more noise than a pixel's own past.
TEST(MotionSolver, NoiseOfAFlatPictureIsAveragedOut) {
  for (const double noise : {0.05, 0.5}) {
    Stream stream([](double, double, double) { return 1.0; }, noise, 24);
    EXPECT_LT(stream.error(settings_of(Method::kMotion, noise), 23),
              0.6 * stream.error(settings_of(Method::kMmae, noise), 23));
  }
}

// Where noise exceeds the scene, up to eight past frames are used: a lost frame cuts off the older five.
TEST(MotionSolver, InNoiseTheFarPastHelps) {
  Stream whole(pan(1.5, 0.3), 0.8, 40);
  Stream lossy(pan(1.5, 0.3), 0.8, 40);
  lossy.lose(30);
  for (const int lookahead : {0, 1}) {
    double with = 0.0;
    double without = 0.0;
    for (const int k : {36, 37, 38}) {
      with += whole.error(settings_of(Method::kMotion, 0.8, lookahead), k);
      without += lossy.error(settings_of(Method::kMotion, 0.8, lookahead), k);
    }
    EXPECT_LT(with, 0.97 * without) << lookahead;
  }
}

// With a rolling read-out later rows see the scene later; the estimate is for the frame's time.
TEST(MotionSolver, RowDelayIsUndone) {
  constexpr double kDelay = 0.8 / 90;  // periods a row
  const Scene still_time = pan(3.0, 0.5);
  const Scene as_read = [&](double x, double y, double t) { return still_time(x, y, t + kDelay * y); };
  Stream stream(as_read, 0.03, 24);
  const auto solver = solver_of(settings_of(Method::kMotion, 0.03), kDelay * 0.005);
  const double error = rmse(solved(*solver, stream.window_ending_at(23, 0)), picture_of(still_time, kFrame, 23));
  EXPECT_LT(error, 1.3 * stream.error(settings_of(Method::kMotion, 0.03), 23));  // against the scene as it was read
  EXPECT_LT(error,
            0.5 * rmse(stream.estimate(settings_of(Method::kMotion, 0.03), 23), picture_of(still_time, kFrame, 23)));
}

// Frames before the window do not matter, bit for bit: no state can be corrupted for good.
TEST(MotionSolver, AFreshStartGivesTheSame) {
  for (const int lookahead : {0, 1}) {
    Stream stream(pan(2.2, -0.7), 0.1, 40);
    for (const int lost : {26, 30, 31}) stream.lose(lost);
    for (std::uint16_t& v : stream.counts(24)) v = 0;  // a corrupt frame
    const Settings settings = settings_of(Method::kMotion, 0.1, lookahead);
    for (const int k : {25, 27, 28, 33, 34, 38}) {
      EXPECT_EQ(stream.estimate(settings, k), stream.estimate(settings, k, k + lookahead)) << k << " " << lookahead;
    }
  }
}

TEST(MotionSolver, LostFramesCostNoMoreThanMmae) {
  Stream stream(pan(2.5, 0.5), 0.05, 40);
  for (const int lost : {22, 27, 28, 33}) stream.lose(lost);
  for (int k = 21; k < 40; ++k) {
    if (stream.counts(k).empty()) continue;
    const double mmae = stream.error(settings_of(Method::kMmae, 0.05), k);
    EXPECT_LT(stream.error(settings_of(Method::kMotion, 0.05), k), 1.03 * mmae) << k;
  }
}

// A lost frame is replaced by a prediction from the frames before it, on a straight path and on a hand's curve:
// otherwise the next frames would fall back to mmae.
TEST(MotionSolver, OneOrTwoLostFramesCostLittle) {
  const Scene hand = [still = Texture(11)](double x, double y, double t) {
    return still(x - 1.9 * t, y + 30.0 * std::cos(0.09 * t));
  };
  for (const bool turns : {false, true}) {
    const Scene scene = turns ? Scene(hand) : pan(2.5, 0.5);
    for (const int lookahead : {0, 1}) {
      const Settings settings = settings_of(Method::kMotion, 0.05, lookahead);
      Stream whole(scene, 0.05, 30);
      for (const bool two : {false, true}) {
        Stream lossy(scene, 0.05, 30);
        lossy.lose(22);
        if (two) lossy.lose(21);
        for (const int k : {23, 24, 25}) {
          SCOPED_TRACE(::testing::Message() << "frame " << k << ", look-ahead " << lookahead << ", two lost " << two);
          const double error = lossy.error(settings, k);
          const double of_mmae = lossy.error(settings_of(Method::kMmae, 0.05), k);
          EXPECT_LT(error, 0.5 * of_mmae);
          if (turns && k == 23 && lookahead == 0) {
            EXPECT_LT(error, (two ? 0.38 : 0.27) * of_mmae);  // whole frames are sharper than the prediction
          } else {
            EXPECT_LT(error, (two ? 2.0 : 1.5) * whole.error(settings, k));
          }
        }
      }
    }
  }
}

// The misfit along a bend mostly comes from the bend, not from an unknown motion.
TEST(MotionSolver, AHandThatTurns) {
  Stream stream(
      [still = Texture(11, 3.0)](double x, double y, double t) {
        return still(x - 30.0 * std::sin(0.06 * t), y + 60.0 * std::cos(0.06 * t));
      },
      0.03, 60);
  double sum = 0.0;
  for (int k = 24; k < 60; k += 3) sum += std::pow(stream.error(settings_of(Method::kMotion, 0.03), k), 2);
  EXPECT_LT(std::sqrt(sum / 12.0), 0.098);
}

TEST(MotionSolver, PartsAndPointsAreThoseOfTheWholeFrame) {
  Stream stream(pan(2.2, -0.7), 0.1, 24);
  const auto solver = make(settings_of(Method::kMotion, 0.1), format_of(PixelType::kUint16), PixelType::kUint16);
  const WindowView window = stream.window_ending_at(23, 0);
  const auto whole = whole_frame<std::uint16_t>(*solver, window, kFrame);
  expect_parts(*solver, window, kFrame, whole, {{17, 11, 40, 30}}, {5, 700, 11969});
}

// Stuck and blinking pixels missing from the map: neighbours are unaffected, the pixels themselves are mmae's.
TEST(MotionSolver, DefectsAreNotSpread) {
  constexpr int kLast = 39;
  const auto near_defects = [](const Picture& p, const Picture& truth) {
    double sum = 0.0;
    double count = 0.0;
    for (int y = 0; y < kFrame.height; ++y) {
      for (int x = 0; x < kFrame.width; ++x) {
        const int dx = std::abs(x - (x / 20 * 20 + 10));
        const int dy = std::abs(y - (y / 20 * 20 + 10));
        if (std::max(dx, dy) == 0 || std::max(dx, dy) > 4) continue;
        const auto i = static_cast<std::size_t>(y * kFrame.width + x);
        sum += std::pow(p[i] - truth[i], 2);
        count += 1.0;
      }
    }
    return std::sqrt(sum / count);
  };
  for (const bool blinks : {false, true}) {
    Stream stream(pan(3.0, 0.6), 0.03, kLast + 1);
    const Picture truth = stream.truth(kLast);
    const double without = near_defects(stream.estimate(settings_of(Method::kMotion, 0.03), kLast), truth);
    std::mt19937 random(1);
    for (int k = 0; k <= kLast; ++k) {
      for (int y = 10; y < kFrame.height; y += 20) {
        for (int x = 10; x < kFrame.width; x += 20) {
          if (blinks && random() % 3 != 0) continue;
          stream.counts(k)[static_cast<std::size_t>(y * kFrame.width + x)] = 32000;
        }
      }
    }
    const Picture motion = stream.estimate(settings_of(Method::kMotion, 0.03), kLast);
    const Picture mmae = stream.estimate(settings_of(Method::kMmae, 0.03), kLast);
    EXPECT_LT(near_defects(motion, truth), std::min(1.5 * without, 0.3 * near_defects(mmae, truth))) << blinks;
    const std::size_t defect = 30 * kFrame.width + 50;
    EXPECT_NEAR(motion[defect], mmae[defect], 0.01) << blinks;
  }
}

// A NaN pixel stays NaN and affects no other.
TEST(MotionSolver, NotANumberStaysAlone) {
  const Scene scene = pan(2.0, 0.0);
  const auto frames = watch(scene, kFrame, 2.2, 20);
  std::vector<std::vector<float>> values;
  for (const Picture& frame : frames) {
    values.emplace_back();
    for (const double v : frame) values.back().push_back(static_cast<float>(300.0 + v));
  }
  const std::size_t bad = 40 * 133 + 60;
  for (auto& frame : values) frame[bad] = std::nanf("");
  std::vector<const void*> planes;
  for (std::size_t i = 3; i < 20; ++i) planes.push_back(values[i].data());
  const auto solver = make(settings_of(Method::kMotion, 0.05), format_of(PixelType::kFloat32));
  const std::vector<float> out = whole_frame(*solver, {planes, kWindow - 1, 20}, kFrame);
  EXPECT_TRUE(std::isnan(out[bad]));
  const Picture truth = picture_of(scene, kFrame, 19);
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (i == bad) continue;
    ASSERT_NEAR(out[i], 300.0 + truth[i], 3.0) << i;
  }
}

// The measured noise stays finite: an infinite one gave invalid displacements that led out of the frame.
TEST(MotionSolver, AFrameOfInfinityIsOutlived) {
  std::vector<std::vector<float>> values(60, std::vector<float>(kFrame.pixels(), 300.0F));
  std::ranges::fill(values[25], std::numeric_limits<float>::infinity());
  const auto solver = make(settings_of(Method::kMotion, 0.0), format_of(PixelType::kFloat32));
  std::vector<float> out;
  for (std::size_t end = kWindow; end <= values.size(); ++end) {
    std::vector<const void*> planes;
    for (std::size_t i = end - kWindow; i < end; ++i) planes.push_back(values[i].data());
    out = whole_frame(*solver, {planes, kWindow - 1, end}, kFrame);
  }
  EXPECT_TRUE(std::ranges::all_of(out, [](float v) { return std::abs(v - 300.0F) < 0.1F; }));
  EXPECT_LT(solver->noise_k(), 0.01);
}

TEST(MotionSolver, NoNoiseIsTooMuch) {
  Stream stream(pan(2.0, 0.0), 0.05, 30);
  for (const double noise_k : {1e6, 1e10, 1e30, 1e300}) {
    const auto solver = solver_of(settings_of(Method::kMotion, noise_k));
    Picture out;
    for (int k = kWindow; k < stream.frames(); ++k) out = solved(*solver, stream.window_ending_at(k, 0));
    EXPECT_TRUE(std::ranges::all_of(out, [](double v) { return std::abs(v) < 100.0; })) << noise_k;
  }
}

TEST(MotionSolver, SmallFramesFallBackToMmae) {
  constexpr Geometry kSmall{9, 5};
  std::vector<std::vector<std::uint16_t>> frames(kWindow, std::vector<std::uint16_t>(45));
  std::vector<const void*> planes;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    for (std::size_t i = 0; i < 45; ++i)
      frames[k][i] = static_cast<std::uint16_t>(30000 + 40 * ((i * 7 + k * k * 3) % 13));
    planes.push_back(frames[k].data());
  }
  const auto by = [&](Method method) {
    const auto solver = make(settings_of(method, 0.05), {.geometry = kSmall}, PixelType::kUint16);
    return whole_frame<std::uint16_t>(*solver, {planes, kWindow - 1, 17}, kSmall);
  };
  EXPECT_EQ(by(Method::kMotion), by(Method::kMmae));
}

// One frame every ten seconds, and a tau of 90,000 frames: the first gave frames of NaN, the second crashed.
TEST(MotionSolver, InertiaWithoutWeightsFallsBackToMmae) {
  Stream stream(pan(1.5, 0.3), 0.03, 24);
  for (Settings settings : {Settings{.tau_s = 0.011, .period_s = 10.0}, Settings{.tau_s = 0.9, .period_s = 1e-5}}) {
    settings.noise_k = 0.03;
    const auto by = [&](Method method) {
      settings.method = method;
      return stream.estimate(settings, 22);
    };
    EXPECT_LT(rmse(by(Method::kMotion), by(Method::kMmae)), 1e-3) << settings.tau_s / settings.period_s;
  }
}

// Points of a capture form a row of pixels: unused plane margins would take a hundred times its memory.
TEST(MotionSolver, ARowOfPixelsTakesLittleMemory) {
  StreamFormat format = format_of(PixelType::kUint16);
  format.geometry = {200'000, 1};
  const auto taken = [] {
    const auto info = mallinfo2();
    return info.uordblks + info.hblkhd;
  };
  const std::size_t before = taken();
  const auto solver = must(Solver::create(settings_of(Method::kMotion, 0.05), format, PixelType::kUint16));
  EXPECT_LT((taken() - before) / format.geometry.pixels(), 300U) << "bytes a pixel";
}

// The solver's motion output for frame k.
SceneMotion motion_of(Stream& stream, int k, double noise, int lookahead = 0) {
  const auto solver = solver_of(settings_of(Method::kMotion, noise, lookahead));
  solver->prepare(stream.window_ending_at(k + lookahead, lookahead));
  EXPECT_NE(solver->motion(), nullptr);
  return solver->motion() != nullptr ? *solver->motion() : SceneMotion(kFrame);
}

// 17 x 12 blocks; those along the border see new content coming in.
bool is_inside(const SceneMotion& motion, std::size_t block) {
  const auto column = static_cast<int>(block) % motion.size.width;
  const auto row = static_cast<int>(block) / motion.size.width;
  return column > 1 && row > 1 && column < motion.size.width - 2 && row < motion.size.height - 2;
}

TEST(MotionOutput, IsTheWayFromTheFrameBefore) {
  for (const int lookahead : {0, 1}) {
    Stream stream(pan(2.4, -0.8), 0.05, 26);
    const SceneMotion motion = motion_of(stream, 23, 0.05, lookahead);
    ASSERT_EQ(motion.size, (Geometry{17, 12}));
    EXPECT_NEAR(motion.affine[0], 2.4, 0.05);
    EXPECT_NEAR(motion.affine[3], -0.8, 0.05);
    for (std::size_t i = 0; i < motion.blocks.size(); ++i) {
      if (!is_inside(motion, i)) continue;
      EXPECT_NEAR(motion.blocks[i].x, 2.4, 0.2) << i;
      EXPECT_NEAR(motion.blocks[i].y, -0.8, 0.2) << i;
      EXPECT_GT(motion.blocks[i].confidence, 0.6F) << i;
    }
  }
}

// Zoom and roll about the frame's centre.
TEST(MotionOutput, AffineIsInPixelsAboutTheCentre) {
  constexpr double kZoom = 0.01;  // a frame
  constexpr double kRoll = 0.02;
  const Texture texture(5);
  const Scene scene = [&](double x, double y, double t) {
    const double X = x - 66.0;
    const double Y = y - 44.5;
    const double s = std::exp(-kZoom * t);
    const double c = std::cos(kRoll * t);
    const double n = std::sin(kRoll * t);
    return texture(s * (c * X + n * Y), s * (c * Y - n * X));
  };
  Stream stream(scene, 0.03, 24);
  const SceneMotion motion = motion_of(stream, 23, 0.03);
  EXPECT_NEAR(motion.affine[0], 0.0, 0.05);
  EXPECT_NEAR(motion.affine[3], 0.0, 0.05);
  EXPECT_NEAR(motion.affine[1], kZoom, 0.002);
  EXPECT_NEAR(motion.affine[2], -kRoll, 0.003);
  EXPECT_NEAR(motion.affine[4], kRoll, 0.003);
  EXPECT_NEAR(motion.affine[5], kZoom, 0.002);
}

TEST(MotionOutput, ConfidenceIsThatOfWhatIsSeen) {
  const auto mean_confidence = [](const SceneMotion& motion) {
    double sum = 0.0;
    int blocks = 0;
    for (std::size_t i = 0; i < motion.blocks.size(); ++i) {
      if (is_inside(motion, i)) sum += static_cast<double>(motion.blocks[i].confidence), ++blocks;
    }
    return sum / blocks;
  };
  Stream flat([](double, double, double) { return 1.0; }, 0.1, 20);
  Stream bars([](double x, double, double t) { return 3.0 * std::tanh(std::sin(0.2 * (x - 1.5 * t))); }, 0.1, 20);
  Stream rest(pan(0.0, 0.0), 0.05, 20);
  Stream cut([](double x, double y, double t) { return Texture(t < 16.5 ? 11U : 12U)(x, y); }, 0.1, 20);
  EXPECT_LT(mean_confidence(motion_of(flat, 18, 0.1)), 0.05) << "nothing to see";
  EXPECT_LT(mean_confidence(motion_of(bars, 18, 0.1)), 0.1) << "edges of one direction alone";
  EXPECT_GT(mean_confidence(motion_of(rest, 18, 0.05)), 0.8) << "at rest, and sure of it";
  EXPECT_LT(mean_confidence(motion_of(cut, 17, 0.1)), 0.3) << "two frames that do not match";
}

TEST(MotionOutput, IsAbsentWhereItIsNotKnown) {
  Stream stream(pan(2.0, 0.0), 0.05, 30);
  stream.lose(22);
  const auto solver = solver_of(settings_of(Method::kMotion, 0.05));
  for (int k = 16; k < 30; ++k) {
    if (k == 22) continue;
    solver->prepare(stream.window_ending_at(k, 0));
    EXPECT_EQ(solver->motion() != nullptr, k < 22 || k > 24) << k << ": a displacement is that of three frames";
  }
  for (const Method method : {Method::kAdmm, Method::kMmae, Method::kInverse}) {
    const auto other = solver_of(settings_of(method, 0.05));
    other->prepare(stream.window_ending_at(20, 0));
    EXPECT_EQ(other->motion(), nullptr);
  }
}

TEST(MotionSolver, RefusesWhatItCannotDo) {
  Settings settings = settings_of(Method::kMotion, 0.05, 2);
  EXPECT_FALSE(validate(settings));
  settings = settings_of(Method::kMotion, 0.05);
  settings.window = 9;
  EXPECT_FALSE(validate(settings));
}

}  // namespace bolo::deblur::solver_test
