// Whole diagnoses of small simulated sessions of the blind check's bench, and of real captures.
#include "src/diagnose/diagnose.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <set>

#include "tests/diagnose/bench.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::diagnose::diagnose_test {
namespace {

using tools::blind::DrawOptions;

bool go_on(const std::string&, double) { return true; }

constexpr double kHalfPeriodPx = 10.0;  // of the bench's bars

std::string names(const Report& report) {
  std::string all;
  for (const FoundEffect& e : report.effects) all += e.name + " ";
  return all + "(" + report.verdict + ": " + report.unexplained.where + ")";
}

bool has(const Report& report, const std::string& name) {
  return std::ranges::count(report.effects, name, &FoundEffect::name) != 0;
}

class Diagnosis : public ::testing::Test {
 protected:
  // Six captures of the bench, 32x24, all with the effects.
  std::vector<std::filesystem::path> bench(const std::vector<std::string>& effects, std::uint64_t seed,
                                           Geometry geometry = {32, 24}) {
    DrawOptions options;
    options.geometry = geometry;
    options.seed = seed;
    auto session = tools::blind::draw_session(options, tools::blind::Kind::kEffectFree, 0);
    EXPECT_TRUE(session) << session.error().message;
    for (const std::string& text : effects) {
      auto effect = sim::parse_effect(text);
      EXPECT_TRUE(effect) << effect.error().message;
      for (auto& capture : session->captures) capture.effects.push_back(*effect);
    }
    auto files = tools::blind::write_captures(*session, scratch_.path());
    EXPECT_TRUE(files) << files.error().message;
    return *files;
  }

  Report diagnosed(const std::vector<std::filesystem::path>& files, const std::vector<std::string>& withheld = {}) {
    Options options;
    options.withheld = withheld;
    auto report = diagnose(files, options, go_on);
    EXPECT_TRUE(report) << report.error().message;
    return report ? *report : Report{};
  }

  Scratch scratch_;
};

TEST_F(Diagnosis, FindsNothingWhereNothingIs) {
  const Report report = diagnosed(bench({}, 11));
  EXPECT_EQ(report.verdict, "no_gap") << names(report);
  EXPECT_TRUE(report.effects.empty()) << names(report);
  EXPECT_NEAR(report.gap_before, 1.0, 0.05);
  EXPECT_NEAR(report.gap_after, 1.0, 0.05);
  EXPECT_TRUE(report.warnings.empty());
  EXPECT_TRUE(report.not_identifiable.empty());
  EXPECT_EQ(report.inputs.size(), 6U);
  EXPECT_NEAR(report.noise_floor_k, 0.0301, 0.0005);
  EXPECT_EQ(report.frames, 2000U);
}

struct Case {
  std::string effect;
  std::string name;
  std::string key;
  double truth = 0.0;
  double tolerance = 0.0;  // of the estimate, as a share
};

std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

class OneEffect : public Diagnosis, public ::testing::WithParamInterface<Case> {};

TEST_P(OneEffect, IsNamedFirstWithItsSize) {
  const Case& c = GetParam();
  const Report report = diagnosed(bench({c.effect}, 12));
  ASSERT_FALSE(report.effects.empty()) << names(report);
  const FoundEffect& first = report.effects.front();
  ASSERT_EQ(first.name, c.name) << names(report);
  EXPECT_GT(first.confidence, 0.9);
  ASSERT_TRUE(first.parameters.contains(c.key));
  const Estimate& e = first.parameters.at(c.key);
  EXPECT_NEAR(e.value / c.truth, 1.0, c.tolerance);
  EXPECT_LE(e.low, e.value);
  EXPECT_GE(e.high, e.value);
  // The interval is of use: neither a point nor everything.
  EXPECT_GT(e.high - e.low, 0.0);
  EXPECT_LT(e.high - e.low, 0.6 * std::abs(c.truth));
  EXPECT_LT(report.gap_after, 1.1) << names(report);
  EXPECT_LT(report.gap_after, report.gap_before + 0.01);
  EXPECT_NE(report.verdict, "no_gap") << names(report);
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

// Levels that are off have emissivity tried in both of its forms.
TEST_F(Diagnosis, NamesEachAlternativeOnce) {
  const Report report = diagnosed(bench({"slow_pole:share=0.05,slow_tau_s=0.15"}, 12, {64, 24}));
  ASSERT_FALSE(report.effects.empty()) << names(report);
  const FoundEffect& first = report.effects.front();
  EXPECT_GT(first.alternatives.size(), 1U);
  std::set<std::string> once{first.name};
  for (const Alternative& other : first.alternatives) EXPECT_TRUE(once.insert(other.name).second) << other.name;
}

class Withheld : public Diagnosis, public ::testing::WithParamInterface<Case> {};

TEST_P(Withheld, IsSaidToBeUnknown) {
  const Case& c = GetParam();
  const Report report = diagnosed(bench({c.effect}, 13), {c.name});
  EXPECT_EQ(report.verdict, "unknown_effect") << names(report);
  EXPECT_FALSE(has(report, c.name)) << names(report);
  EXPECT_FALSE(report.unexplained.where.empty());
  EXPECT_FALSE(report.unexplained.stage.empty());
  EXPECT_LT(report.unexplained.p_value, 1e-3);
  EXPECT_EQ(report.withheld, std::vector<std::string>{c.name});
}

INSTANTIATE_TEST_SUITE_P(OfTheCatalogue, Withheld,
                         ::testing::Values(Case{"row_delay:row_delay_s=2.8e-5", "row_delay", "", 0.0, 0.0},
                                           Case{"flicker:sigma_k=0.009", "flicker", "", 0.0, 0.0},
                                           Case{"fpn_offset:pixel_k=0.03,column_k=0.015", "fpn_offset", "", 0.0, 0.0},
                                           Case{"vignetting:corner_loss=0.04", "vignetting", "", 0.0, 0.0}),
                         [](const auto& made) { return made.param.name; });

TEST_F(Diagnosis, DoesNotDependOnTheNumberOfThreads) {
  auto files = bench({"tau_global:scale=1.1"}, 14);
  files.resize(3);
  Options one;
  one.threads = 1;
  Options three;
  three.threads = 3;
  const auto a = diagnose(files, one, go_on);
  const auto b = diagnose(files, three, go_on);
  ASSERT_TRUE(a && b);
  EXPECT_TRUE(has(*a, "tau_global")) << names(*a);
  EXPECT_EQ(names(*a), names(*b));
  EXPECT_DOUBLE_EQ(a->gap_before, b->gap_before);
  EXPECT_DOUBLE_EQ(a->gap_after, b->gap_after);
}

TEST_F(Diagnosis, OfAShutterAloneSaysWhatItCannotTell) {
  const auto files = bench({"tau_global:scale=1.1"}, 15);
  const Report report = diagnosed({files.front()});
  EXPECT_EQ(report.verdict, "no_gap") << names(report);
  const auto missing = std::ranges::find(report.not_identifiable, "tau_global", &NotIdentifiable::effect);
  ASSERT_NE(missing, report.not_identifiable.end());
  EXPECT_FALSE(missing->needs.empty());
}

// Real recordings, of which nothing is known but what they look at.
class FieldRecording : public Diagnosis {
 protected:
  Report recorded(const std::string& name) {
    const char* folder = std::getenv("BOLO_TEST_DATA");
    if (folder == nullptr) return {};
    const auto file = std::filesystem::path(folder) / "captures" / name;
    return std::filesystem::exists(file) ? diagnosed({file}) : Report{};
  }
};

TEST_F(FieldRecording, OfABlackBodyFlickers) {
  const Report report = recorded("atto320_blackbody_25C.h5");
  if (report.inputs.empty()) GTEST_SKIP() << "BOLO_TEST_DATA has no captures/atto320_blackbody_25C.h5";
  EXPECT_TRUE(has(report, "flicker")) << names(report);
  EXPECT_FALSE(has(report, "tau_global"));
}

TEST_F(FieldRecording, OfADriveBlamesNothingThatItCannotTell) {
  const Report report = recorded("a65_drive_a.h5");
  if (report.inputs.empty()) GTEST_SKIP() << "BOLO_TEST_DATA has no captures/a65_drive_a.h5";
  for (const char* name :
       {"tau_global", "tau_spread", "slow_pole", "row_delay", "optical_psf", "crosstalk", "jitter"}) {
    EXPECT_FALSE(has(report, name)) << names(report);
  }
  EXPECT_FALSE(report.not_identifiable.empty());
}

}  // namespace
}  // namespace bolo::diagnose::diagnose_test
