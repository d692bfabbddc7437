// The diagnosis on cameras and benches of the blind check's second reality, which share nothing with the simulator.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "src/diagnose/diagnose.hpp"
#include "tests/scratch.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::diagnose::reality_test {
namespace {

namespace blind = tools::blind;

class SecondReality : public ::testing::Test {
 protected:
  Report diagnosed(blind::Kind kind, std::size_t index, const std::string& only = {}, bool imperfect = false) {
    blind::DrawOptions options;
    options.imperfect = imperfect;
    options.reality = blind::Reality::kSecond;
    options.only = only;
    const auto session = blind::draw_session(options, kind, index);
    EXPECT_TRUE(session) << session.error().message;
    const auto files = blind::write_captures(*session, scratch_.path());
    EXPECT_TRUE(files) << files.error().message;
    auto report = diagnose(*files, Options{}, [](const std::string&, double) { return true; });
    EXPECT_TRUE(report) << report.error().message;
    return report ? *report : Report{};
  }
  static std::string names(const Report& report) {
    std::string all = report.verdict + ":";
    for (const FoundEffect& effect : report.effects) all += ' ' + effect.name;
    return all;
  }

  Scratch scratch_;
};

// Its bars lean within the height of a pixel.
TEST_F(SecondReality, WithoutAnEffectShowsNoGap) {
  EXPECT_EQ(names(diagnosed(blind::Kind::kEffectFree, 0)), "no_gap:");
}

// The edges of its target are straight ramps.
TEST_F(SecondReality, AnImperfectBenchIsNotTheCameras) {
  const Report report = diagnosed(blind::Kind::kEffectFree, 1, {}, true);
  EXPECT_EQ(names(report), "no_gap:");
}

// Its loss towards the corners is a cosine law about a place of its own.
TEST_F(SecondReality, WhatIsSmoothIsNoMapOfPixels) {
  EXPECT_EQ(names(diagnosed(blind::Kind::kSingle, 0, "vignetting")), "explained: vignetting");
}

// Levels that are free would swallow it.
TEST_F(SecondReality, LevelsOfAGoodBenchTellTheEmissivity) {
  EXPECT_EQ(names(diagnosed(blind::Kind::kSingle, 0, "emissivity")), "explained: emissivity");
}

// Its gains were made equal at 298.15 K.
TEST_F(SecondReality, GainsNeedNoOffsets) {
  const Report report = diagnosed(blind::Kind::kSingle, 0, "fpn_gain");
  ASSERT_EQ(names(report), "explained: fpn_gain");
  const Estimate& reference = report.effects.front().parameters.at("reference_k");
  EXPECT_NEAR(reference.value, 298.15, 0.5);
  EXPECT_LT(reference.high - reference.low, 5.0);
}

TEST_F(SecondReality, AWrongDescriptionIsNotTheCameras) {
  for (std::size_t i = 0; i < blind::kMisdescribed.size(); ++i) {
    std::filesystem::remove_all(scratch_.path());
    std::filesystem::create_directories(scratch_.path());
    const Report report = diagnosed(blind::Kind::kBench, i);
    EXPECT_EQ(names(report), "bench_description:") << blind::kMisdescribed[i];
    EXPECT_FALSE(report.needs.empty());
  }
}

}  // namespace
}  // namespace bolo::diagnose::reality_test
