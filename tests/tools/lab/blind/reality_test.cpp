// The second reality against closed forms of the simplest cases.
#include "tools/lab/blind/session.hpp"

#include "tests/tools/program.hpp"
namespace bolo::tools::blind::reality_test {

Session drawn(Kind kind, std::size_t index) {
  return draw_session({.geometry = {16, 12}, .reality = Reality::kSecond}, kind, index).value();
}

// Mean of the frame, K.
double mean_of(const std::vector<std::uint16_t>& counts, std::size_t frame) {
  constexpr std::size_t kPixels = 16 * 12;
  double sum = 0.0;
  for (std::size_t p = 0; p < kPixels; ++p) sum += counts[frame * kPixels + p] * 0.01;
  return sum / static_cast<double>(kPixels);
}

TEST(SecondReality, TheSameSeedGivesTheSameFrames) {
  const Session session = drawn(Kind::kPair, 3);
  EXPECT_EQ(to_json(session), to_json(drawn(Kind::kPair, 3)));
  EXPECT_EQ(second::film(session, session.captures[5]), second::film(session, session.captures[5]));
}

TEST(SecondReality, AStillFieldIsAtItsTemperature) {
  const Session session = drawn(Kind::kEffectFree, 0);
  const auto counts = second::film(session, session.captures[0]);
  EXPECT_NEAR(mean_of(counts, 100), 299.0 - 0.005, 0.01);  // values are cut to counts of 10 mK
}

// tau dT/dt + T = T_ss: after a switch the frames' means fall as exp(-t / tau).
TEST(SecondReality, PixelsFollowTheirTimeConstant) {
  for (const double scale : {1.0, 0.9}) {
    Session session = drawn(Kind::kEffectFree, 0);
    CapturePlan plan = session.captures[2];
    if (scale != 1.0) plan.effects.push_back({"tau_global", "", {{"scale", scale}}});
    const auto counts = second::film(session, plan);
    const auto& chopper = std::get<capture::Chopper>(plan.stimulus);
    const auto first = static_cast<std::size_t>(chopper.off_s[0] / 0.005) + 4;
    const double ratio = (mean_of(counts, first + 4) - 296.495) / (mean_of(counts, first) - 296.495);
    EXPECT_NEAR(-0.02 / std::log(ratio), 0.011 * scale, 0.011 * 0.02) << scale;
  }
}

TEST(SecondReality, EveryEffectOfTheCatalogueIsHidden) {
  for (const sim::EffectDescription& effect : sim::effect_descriptions()) {
    const DrawOptions options{.only = std::string(effect.name), .reality = Reality::kSecond};
    EXPECT_TRUE(!effect.in_catalogue || draw_session(options, Kind::kSingle, 0)) << effect.name;
  }
}

// Using them would make it dependent.
TEST(SecondReality, UsesNeitherSimulatorNorDiagnosis) {
  for (const char* name : {"reality.cpp", "reality_draw.cpp", "reality_scene.cpp", "reality.hpp"}) {
    const std::string text = test::contents(std::filesystem::path(BOLO_SOURCE_DIR) / "tools/lab/blind" / name);
    EXPECT_FALSE(text.empty()) << name;
    EXPECT_EQ(text.find("#include \"src/sim"), std::string::npos) << name;
    EXPECT_EQ(text.find("#include \"src/diagnose"), std::string::npos) << name;
  }
}

}  // namespace bolo::tools::blind::reality_test
