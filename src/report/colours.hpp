// The colours of all plots and pages: one thing has one colour wherever it is shown, on light paper and on dark.
#pragma once

#include <cstddef>
#include <cstdint>

namespace bolo::plot {

// After Okabe and Ito, "Color Universal Design" (2008), which eyes with any common kind of colour blindness tell apart;
// darker on light paper and lighter on dark paper than theirs, so that words in them can be read (4.5 to 1).
enum class Hue : std::uint8_t {
  kBlurred,    // what the camera sends; before; nominal. Vermilion
  kDeblurred,  // what Bolo makes of it; after; predicted. Blue
  kTruth,      // what is known from elsewhere: truth, measurement. Ink
  kSoft,       // what is only there for reference. Grey
  kGreen,      // other methods, as they come
  kPurple,
  kAmber,
  kBad,    // lost, broken. Red; never alone: a word or a shape says it too
  kWhite,  // on planes of values, whatever the paper
};
inline constexpr std::size_t kHues = 9;

struct Rgb {
  std::uint8_t red = 0;
  std::uint8_t green = 0;
  std::uint8_t blue = 0;
  bool operator==(const Rgb&) const = default;
};

struct HueColours {
  const char* name;  // of the style sheet's classes: s-NAME strokes, f-NAME fills
  Rgb on_light;
  Rgb on_dark;
};
const HueColours& colours_of(Hue hue) noexcept;

// For planes of values. Lightness rises evenly in the first two, so they also read in grey.
enum class Ramp : std::uint8_t {
  kIron,       // thermal images: black, violet, orange, yellow, white
  kViridis,    // any other quantity
  kDiverging,  // both signs: blue, grey, orange
};
// The colour at `level` (0..1; beyond that the ends'). Thread: any.
Rgb colour_at(Ramp ramp, double level) noexcept;

}  // namespace bolo::plot
