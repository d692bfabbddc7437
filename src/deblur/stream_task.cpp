#include "src/deblur/stream_task.hpp"

#include <cmath>

namespace bolo::deblur {
namespace {

constexpr double kKelvinPerCount = 0.01;

}  // namespace

double StreamTask::kelvin_per_value() const {
  return input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : kKelvinPerCount;
}

double StreamTask::in_kelvin(double value) const {
  return input.scale.unit == Unit::kKelvin ? value * std::abs(input.scale.scale) : value;
}

double StreamTask::lambda_half() const {
  const double unit = input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : 1.0;
  return settings.half_square_lambda() / unit;
}

}  // namespace bolo::deblur
