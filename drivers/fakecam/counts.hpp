// From a stored plane to the 16-bit counts that a camera sends.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/plane.hpp"

namespace bolo::fakecam {

// FLIR's IRFormat: what a count means.
enum class IrFormat : std::uint32_t {
  kRadiometric = 0,             // proportional to radiance; the Planck constants lead to a temperature
  kTemperatureLinear100mK = 1,  // kelvin * 10
  kTemperatureLinear10mK = 2,   // kelvin * 100
};

// Radiance counts of an object with emissivity 1 behind a clear atmosphere: J0 + J1 * R / (exp(B / kelvin) - F).
struct PlanckConstants {
  double r = 17000.0;
  double b = 1428.0;
  double f = 1.0;
  double j0 = 4000.0;
  double j1 = 60.0;
};
inline constexpr PlanckConstants kPlanck;

// Crops planes of one format and converts them to counts. Planes in kelvin become counts of the IrFormat, rounded and
// clamped to 16 bits; planes in counts go out as they are. Thread: one at a time.
class CountConverter {
 public:
  // `region` lies inside format.geometry.
  CountConverter(const StreamFormat& format, IrFormat ir_format, Region region);

  // `plane`: the whole stored plane. `out`: region.width * region.height counts, row-major. noexcept, no allocation.
  void convert(const void* plane, std::uint16_t* out) const noexcept;

 private:
  std::uint16_t count_of(double stored) const noexcept;

  StreamFormat format_;
  IrFormat ir_format_;
  Region region_;
  std::vector<std::uint16_t> table_;  // counts of each 16-bit stored value; empty when they are equal
};

}  // namespace bolo::fakecam
