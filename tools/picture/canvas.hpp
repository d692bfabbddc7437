// A page to draw on: text, thermal images and curves, saved as PNG. Cairo does the drawing.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "bolo/core/geometry.hpp"
#include "bolo/core/result.hpp"
#include "tools/picture/palette.hpp"

namespace bolo::tools {

struct Box {  // in pixels of the page
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;
};

enum class Align { kLeft, kCentre, kRight };

struct TextStyle {
  double size = 13.0;
  bool bold = false;
  Colour colour = kInk;
  Align align = Align::kLeft;
};

struct TemperatureRange {
  double low = 0.0;   // the palette's dark end
  double high = 1.0;  // its bright end
};

struct Axis {
  double low = 0.0;
  double high = 1.0;
  std::string label;  // with its unit
};

class Canvas {
 public:
  Canvas(int width, int height);
  ~Canvas();
  Canvas(Canvas&&) noexcept;
  Canvas& operator=(Canvas&&) noexcept;

  // (x, y) is the text's base line.
  void text(double x, double y, const std::string& words, const TextStyle& style = {});

  // The region of a row-major image, stretched over `where` without smoothing: a pixel stays a pixel.
  void thermal(const Box& where, std::span<const float> image, Geometry geometry, Region region, TemperatureRange range,
               Palette palette = Palette::kIron);

  // The palette from low to high with its ends and middle labelled.
  void colour_bar(const Box& where, TemperatureRange range, const std::string& unit, Palette palette = Palette::kIron);

  void rectangle(const Box& where, Colour colour, double line_width = 1.5);
  void fill(const Box& where, Colour colour);
  void line(double from_x, double from_y, double to_x, double to_y, Colour colour, double line_width = 1.0);
  void disc(double x, double y, double radius, Colour colour);

  // Frame, ticks at round numbers and labels of a plot area; curves go into the same box with the same axes.
  void axes(const Box& where, const Axis& x, const Axis& y);
  void curve(const Box& where, const Axis& x, const Axis& y, std::span<const double> xs, std::span<const double> ys,
             Colour colour, double line_width = 1.8);

  // ErrorKind::kBadInput when the file cannot be written.
  Status save(const std::string& file) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::tools
