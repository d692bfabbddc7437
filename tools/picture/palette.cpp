#include "tools/picture/palette.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::tools {
namespace {

constexpr std::uint32_t kNanColour = 0x00C000;

struct Stop {
  double level;
  Colour colour;
};

// Lightness rises evenly from stop to stop, so that the picture also reads in grey.
constexpr std::array<Stop, 7> kIron{{{0.00, {0.00, 0.00, 0.04}},
                                     {0.18, {0.19, 0.02, 0.44}},
                                     {0.38, {0.55, 0.03, 0.56}},
                                     {0.55, {0.84, 0.22, 0.31}},
                                     {0.72, {0.96, 0.48, 0.10}},
                                     {0.88, {0.99, 0.80, 0.25}},
                                     {1.00, {1.00, 1.00, 0.92}}}};

Colour iron(double level) {
  const auto upper = std::find_if(kIron.begin() + 1, kIron.end() - 1, [&](const Stop& s) { return level <= s.level; });
  const Stop& a = *(upper - 1);
  const Stop& b = *upper;
  const double w = (level - a.level) / (b.level - a.level);
  return {std::lerp(a.colour.red, b.colour.red, w), std::lerp(a.colour.green, b.colour.green, w),
          std::lerp(a.colour.blue, b.colour.blue, w)};
}

}  // namespace

std::uint32_t colour_of(Palette palette, double level) {
  if (std::isnan(level)) return kNanColour;
  const double clamped = std::clamp(level, 0.0, 1.0);
  const Colour c = palette == Palette::kIron ? iron(clamped) : Colour{clamped, clamped, clamped};
  const auto byte = [](double v) { return static_cast<std::uint32_t>(std::lround(v * 255.0)); };
  return byte(c.red) << 16 | byte(c.green) << 8 | byte(c.blue);
}

}  // namespace bolo::tools
