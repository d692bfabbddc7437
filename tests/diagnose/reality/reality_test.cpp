// Diagnosis of cameras and benches of the blind check's second reality, which is independent of the simulator.
#include "tests/diagnose/blind_bench.hpp"

namespace bolo::diagnose::reality_test {

using testing::told;

class SecondReality : public testing::BlindBench {
 protected:
  Report diagnosed(Kind kind, std::size_t index, const std::string& only = {}, bool imperfect = false) {
    return testing::diagnosed(
        bench({.imperfect = imperfect, .only = only, .reality = tools::blind::Reality::kSecond}, {}, kind, index));
  }
};

// Its bars are slanted within a pixel's height.
TEST_F(SecondReality, WithoutAnEffectShowsNoGap) { EXPECT_EQ(told(diagnosed(Kind::kEffectFree, 0)), "no_gap:"); }

// The edges of its target are straight ramps.
TEST_F(SecondReality, AnImperfectBenchIsNotTheCameras) {
  EXPECT_EQ(told(diagnosed(Kind::kEffectFree, 1, {}, true)), "no_gap:");
}

// Its corner loss is a cosine law about another centre.
TEST_F(SecondReality, WhatIsSmoothIsNoMapOfPixels) {
  EXPECT_EQ(told(diagnosed(Kind::kSingle, 0, "vignetting")), "explained: vignetting");
}

// Free levels would absorb the emissivity.
TEST_F(SecondReality, LevelsOfAGoodBenchTellTheEmissivity) {
  EXPECT_EQ(told(diagnosed(Kind::kSingle, 0, "emissivity")), "explained: emissivity");
}

// Its gains are equalised at 298.15 K.
TEST_F(SecondReality, GainsNeedNoOffsets) {
  const Report report = diagnosed(Kind::kSingle, 0, "fpn_gain");
  ASSERT_EQ(told(report), "explained: fpn_gain");
  const Estimate& reference = report.effects.front().parameters.at("reference_k");
  EXPECT_NEAR(reference.value, 298.15, 0.5);
  EXPECT_LT(reference.high - reference.low, 5.0);
}

TEST_F(SecondReality, AWrongDescriptionIsNotTheCameras) {
  for (std::size_t i = 0; i < tools::blind::kMisdescribed.size(); ++i) {
    std::filesystem::remove_all(scratch_.path());
    std::filesystem::create_directories(scratch_.path());
    const Report report = diagnosed(Kind::kBench, i);
    EXPECT_EQ(told(report), "bench_description:") << tools::blind::kMisdescribed[i];
    EXPECT_FALSE(report.needs.empty());
  }
}

}  // namespace bolo::diagnose::reality_test
