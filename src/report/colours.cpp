#include "src/report/colours.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace bolo::plot {
namespace {

constexpr std::array<HueColours, kHues> kColours{{{"blurred", {0xc2, 0x4a, 0x08}, {0xf0, 0x90, 0x3f}},
                                                  {"deblurred", {0x00, 0x68, 0xa8}, {0x5d, 0xb8, 0xee}},
                                                  {"truth", {0x1a, 0x21, 0x2d}, {0xe5, 0xe9, 0xf0}},
                                                  {"soft", {0x66, 0x70, 0x83}, {0x97, 0xa2, 0xb4}},
                                                  {"green", {0x0a, 0x7a, 0x5a}, {0x4c, 0xc7, 0x9c}},
                                                  {"purple", {0x9a, 0x42, 0x82}, {0xdd, 0x9c, 0xc4}},
                                                  {"amber", {0x8a, 0x64, 0x00}, {0xf0, 0xd9, 0x5a}},
                                                  {"bad", {0xb3, 0x12, 0x3f}, {0xff, 0x7a, 0x96}},
                                                  {"white", {0xff, 0xff, 0xff}, {0xff, 0xff, 0xff}}}};

struct Stop {
  double level;
  std::array<double, 3> rgb;
};
constexpr std::array<Stop, 7> kIron{{{0.00, {0.00, 0.00, 0.04}},
                                     {0.18, {0.19, 0.02, 0.44}},
                                     {0.38, {0.55, 0.03, 0.56}},
                                     {0.55, {0.84, 0.22, 0.31}},
                                     {0.72, {0.96, 0.48, 0.10}},
                                     {0.88, {0.99, 0.80, 0.25}},
                                     {1.00, {1.00, 1.00, 0.92}}}};
constexpr std::array<Stop, 3> kDiverging{
    {{0.0, {0.13, 0.40, 0.67}}, {0.5, {0.93, 0.93, 0.92}}, {1.0, {0.80, 0.40, 0.05}}}};

// A polynomial of degree six through viridis, one row a colour channel.
constexpr std::array<std::array<double, 7>, 3> kViridis{
    {{0.27772733, 0.10509304, -0.33086183, -4.63423050, 6.22826994, 4.77638500, -5.43545586},
     {0.00540734, 1.40461353, 0.21484756, -5.79910097, 14.17993337, -13.74514538, 4.64585261},
     {0.33409981, 1.38459016, 0.09509516, -19.33244096, 56.69055260, -65.35303263, 26.31243525}}};

std::uint8_t byte(double share) { return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(share, 0.0, 1.0))); }

Rgb between(std::span<const Stop> stops, double level) {
  std::size_t upper = 1;
  while (upper + 1 < stops.size() && level > stops[upper].level) ++upper;
  const Stop& a = stops[upper - 1];
  const Stop& b = stops[upper];
  const double w = (level - a.level) / (b.level - a.level);
  return {byte(std::lerp(a.rgb[0], b.rgb[0], w)), byte(std::lerp(a.rgb[1], b.rgb[1], w)),
          byte(std::lerp(a.rgb[2], b.rgb[2], w))};
}

Rgb viridis(double level) {
  std::array<double, 3> rgb{};
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t k = 7; k-- > 0;) rgb[c] = rgb[c] * level + kViridis[c][k];
  }
  return {byte(rgb[0]), byte(rgb[1]), byte(rgb[2])};
}

}  // namespace

const HueColours& colours_of(Hue hue) noexcept { return kColours[static_cast<std::size_t>(hue)]; }

Rgb colour_at(Ramp ramp, double level) noexcept {
  const double clamped = std::clamp(level, 0.0, 1.0);
  switch (ramp) {
    case Ramp::kIron:
      return between(kIron, clamped);
    case Ramp::kViridis:
      return viridis(clamped);
    case Ramp::kDiverging:
      return between(kDiverging, clamped);
  }
  return {};
}

}  // namespace bolo::plot
