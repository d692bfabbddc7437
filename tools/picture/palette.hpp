// Colours of the project's pictures: palettes for temperature, and line colours that colour-blind readers can tell
// apart.
#pragma once

#include <array>
#include <cstdint>

namespace bolo::tools {

struct Colour {
  double red = 0.0;  // 0..1
  double green = 0.0;
  double blue = 0.0;
};

// Okabe and Ito, "Color Universal Design" (2008): distinguishable with every common kind of colour blindness.
inline constexpr Colour kInk{0.13, 0.14, 0.17};
inline constexpr Colour kFaint{0.62, 0.64, 0.68};
inline constexpr Colour kPaper{1.0, 1.0, 1.0};
inline constexpr Colour kTruthColour{0.0, 0.0, 0.0};
inline constexpr Colour kBlurredColour{0.902, 0.624, 0.0};    // orange
inline constexpr Colour kDeblurredColour{0.0, 0.447, 0.698};  // blue

enum class Palette {
  kIron,      // black, violet, orange, yellow, white: the thermographers' usual one
  kWhiteHot,  // grey
};

// 0xRRGGBB of a level in 0..1; values outside are clamped, NaN is green. Thread: any.
std::uint32_t colour_of(Palette palette, double level);

}  // namespace bolo::tools
