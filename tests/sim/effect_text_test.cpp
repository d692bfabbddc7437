// Effects as text: parsing, error messages, random draws.
#include "src/sim/effect.hpp"
#include "tests/test.hpp"

namespace bolo::sim::effect_text_test {

std::string refusal(std::string_view text) {
  const auto effect = parse_effect(text);
  if (effect) return "accepted";
  EXPECT_EQ(effect.error().exit_code(), 2);
  return effect.error().message;
}

TEST(EffectDescriptions, TheCatalogueAndWhatIsOutsideIt) {
  const std::set<std::string_view> outside{"clipped_range", "column_crosstalk", "gain_drift",    "lens_ghost",
                                           "mains_hum",     "split_readout",    "tau_asymmetry", "torn_frames"};
  std::set<std::string_view> unknown;
  for (const EffectDescription& effect : effect_descriptions()) {
    if (!effect.in_catalogue) unknown.insert(effect.name);
  }
  EXPECT_EQ(unknown, outside);
  EXPECT_EQ(effect_descriptions().size() - unknown.size(), 29U);
  EXPECT_TRUE(std::ranges::is_sorted(effect_descriptions(), {}, &EffectDescription::name));
}

// The documented values and those of the blind check must fit together.
TEST(EffectDescriptions, StandardAndRealisticValuesAreAccepted) {
  for (const EffectDescription& effect : effect_descriptions()) {
    EXPECT_FALSE(effect.about.empty()) << effect.name;
    for (const Parameter& p : effect.parameters) {
      const auto accepted = [&p](double value) { return value >= p.accepted.low && value <= p.accepted.high; };
      EXPECT_FALSE(p.about.empty()) << effect.name << ' ' << p.key;
      EXPECT_TRUE(std::isnan(p.standard) || accepted(p.standard)) << effect.name << ' ' << p.key;
      for (const Range& r : p.realistic) {
        EXPECT_TRUE(accepted(r.low) && accepted(r.high) && r.low <= r.high) << effect.name << ' ' << p.key;
      }
    }
  }
}

TEST(ParseEffect, ReadsNamesKeysAndForms) {
  const auto bare = must(parse_effect("iir"));
  EXPECT_EQ(*bare, (EffectSpec{"iir", "", {}}));
  const auto full = must(parse_effect("iir:alpha=0.6,form=box"));
  EXPECT_EQ(*full, (EffectSpec{"iir", "box", {{"alpha", 0.6}}}));
  EXPECT_EQ(parse_effect("row_delay:row_delay_s=2.8e-5")->values.at("row_delay_s"), 2.8e-5);
}

TEST(ParseEffect, RefusesInOneLineThatNamesTheNearest) {
  EXPECT_EQ(refusal("tauglobal"),
            "there is no effect 'tauglobal'; did you mean 'tau_global'? (bolo simulate --list-effects shows all)");
  EXPECT_EQ(refusal("iir:alpa=1"), "effect iir: there is no key 'alpa'; did you mean 'alpha'?");
  EXPECT_EQ(refusal("iir:alpha=0.01"), "effect iir: alpha=0.01: expected 0.05 to 1");
  EXPECT_EQ(refusal("iir:alpha=nan"), "effect iir: alpha=nan: expected a number");
  EXPECT_EQ(refusal("iir:alpha=1x"), "effect iir: alpha=1x: expected a number");
  EXPECT_EQ(refusal("iir:alpha=1,alpha=1"), "effect iir: alpha is given twice");
  EXPECT_EQ(refusal("iir:form=bax"), "effect iir: there is no form 'bax'; did you mean 'box'?");
  EXPECT_EQ(refusal("tau_global:form=white"), "effect tau_global: it has no forms");
  EXPECT_EQ(refusal("iir:"), "effect iir: nothing follows the colon; expected key=value");
  EXPECT_EQ(refusal("iir:alpha=1,"), "effect iir: nothing follows the last comma; expected key=value");
  EXPECT_EQ(refusal("iir:alpha"), "effect iir: 'alpha': expected key=value");
  EXPECT_EQ(refusal("radiometric_nonlinearity:x=1"),
            "effect radiometric_nonlinearity: there is no key 'x'; it takes none");
  EXPECT_NE(refusal(""), "accepted");
}

TEST(CheckEffects, EachNameOnce) {
  const std::vector<EffectSpec> twice{{"iir", "", {}}, {"drift", "", {}}, {"iir", "box", {}}};
  const Status status = check_effects(twice);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message, "effect iir is given twice; put all its keys into one");
  EXPECT_TRUE(check_effects(std::vector<EffectSpec>{{"iir", "", {}}, {"drift", "", {}}}));
  EXPECT_FALSE(check_effects(std::vector<EffectSpec>{{"iir", "", {{"alpha", 7.0}}}}));
}

TEST(DrawEffect, StaysWithinTheRealisticRangesAndFollowsTheSeed) {
  for (const EffectDescription& effect : effect_descriptions()) {
    for (std::uint64_t seed = 0; seed < 50; ++seed) {
      const auto drawn = draw_effect(effect.name, seed);
      ASSERT_TRUE(drawn);
      EXPECT_EQ(*drawn, draw_effect(effect.name, seed).value());
      for (const Parameter& p : effect.parameters) {
        if (p.realistic.empty()) continue;
        const double value = drawn->values.at(std::string(p.key));
        EXPECT_TRUE(std::ranges::any_of(
            p.realistic, [value](const Range& r) { return value >= r.low - 1e-12 && value <= r.high + 1e-12; }))
            << effect.name << ' ' << p.key << '=' << value;
      }
    }
  }
  EXPECT_NE(draw_effect("tau_global", 1).value(), draw_effect("tau_global", 2).value());
  EXPECT_FALSE(draw_effect("nothing", 1));
}

// Both sides of a range with a gap are drawn, and a wide range is drawn on a logarithmic scale.
TEST(DrawEffect, UsesTheWholeRange) {
  int slower = 0;
  int below_geometric_mean = 0;
  constexpr int kDraws = 400;
  for (std::uint64_t seed = 0; seed < kDraws; ++seed) {
    if (draw_effect("tau_global", seed)->values.at("scale") > 1.0) ++slower;
    if (draw_effect("drift", seed)->values.at("time_s") < std::sqrt(3.0 * 30.0)) ++below_geometric_mean;
  }
  EXPECT_NEAR(slower, kDraws * 0.15 / 0.25, 60);
  EXPECT_NEAR(below_geometric_mean, kDraws / 2, 60);
}

}  // namespace bolo::sim::effect_text_test
