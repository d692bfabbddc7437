// The size of a frame and the meaning of its values.
#pragma once

#include <cstddef>

namespace bolo {

// Planes are stored row-major without padding: pixel (x, y) is element y * width + x.
struct Geometry {
  int width = 0;
  int height = 0;

  constexpr std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  constexpr bool operator==(const Geometry&) const = default;
};

// A rectangle of pixels: columns [x, x + width), rows [y, y + height).
struct Region {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;

  constexpr bool operator==(const Region&) const = default;
  constexpr bool inside(Geometry g) const {
    return x >= 0 && y >= 0 && width > 0 && height > 0 && x <= g.width - width && y <= g.height - height;
  }
};

enum class Unit {
  kKelvin,  // temperature: kelvin = scale * value + offset
  kCount,   // uncalibrated camera counts: scale and offset carry no meaning
};

// Conversion of stored values to temperatures.
struct LinearScale {
  Unit unit = Unit::kKelvin;
  double scale = 0.01;  // K a count; 10 mK is the A655sc's TemperatureLinear10mK
  double offset = 0.0;  // K

  // kelvin from a stored value; for kCount the value itself. Thread: any.
  constexpr double to_physical(double value) const { return unit == Unit::kKelvin ? scale * value + offset : value; }
  constexpr bool operator==(const LinearScale&) const = default;
};

}  // namespace bolo
