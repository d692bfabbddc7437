#include "drivers/fakecam/counts.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace bolo::fakecam {
namespace {

constexpr std::size_t kStoredValues = 65536;

double counts_of_kelvin(double kelvin, IrFormat format) {
  switch (format) {
    case IrFormat::kTemperatureLinear100mK:
      return kelvin * 10.0;
    case IrFormat::kTemperatureLinear10mK:
      return kelvin * 100.0;
    case IrFormat::kRadiometric:
      break;
  }
  if (kelvin <= 0.0) return kPlanck.j0;
  return kPlanck.j0 + kPlanck.j1 * kPlanck.r / (std::exp(kPlanck.b / kelvin) - kPlanck.f);
}

}  // namespace

CountConverter::CountConverter(const StreamFormat& format, IrFormat ir_format, Region region)
    : format_(format), ir_format_(ir_format), region_(region) {
  if (format.type != PixelType::kUint16) return;
  table_.resize(kStoredValues);
  bool identity = true;
  for (std::size_t v = 0; v < kStoredValues; ++v) {
    table_[v] = count_of(static_cast<double>(v));
    identity = identity && table_[v] == v;
  }
  if (identity) table_.clear();
}

std::uint16_t CountConverter::count_of(double stored) const noexcept {
  const double count =
      format_.scale.unit == Unit::kKelvin ? counts_of_kelvin(format_.scale.to_physical(stored), ir_format_) : stored;
  if (!(count > 0.0)) return 0;  // also not a number
  return static_cast<std::uint16_t>(std::lround(std::min(count, 65535.0)));
}

void CountConverter::convert(const void* plane, std::uint16_t* out) const noexcept {
  const auto stride = static_cast<std::size_t>(format_.geometry.width);
  const auto columns = static_cast<std::size_t>(region_.width);
  const std::size_t first = static_cast<std::size_t>(region_.y) * stride + static_cast<std::size_t>(region_.x);
  for (std::size_t row = 0; row < static_cast<std::size_t>(region_.height); ++row, out += columns) {
    const std::size_t from = first + row * stride;
    if (format_.type == PixelType::kFloat32) {
      const float* in = static_cast<const float*>(plane) + from;
      std::transform(in, in + columns, out, [this](float v) { return count_of(static_cast<double>(v)); });
    } else if (table_.empty()) {
      std::memcpy(out, static_cast<const std::uint16_t*>(plane) + from, columns * sizeof(std::uint16_t));
    } else {
      const std::uint16_t* in = static_cast<const std::uint16_t*>(plane) + from;
      std::transform(in, in + columns, out, [this](std::uint16_t v) { return table_[v]; });
    }
  }
}

}  // namespace bolo::fakecam
