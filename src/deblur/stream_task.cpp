#include "src/deblur/stream_task.hpp"

#include <cmath>

namespace bolo::deblur {
namespace {

constexpr double kKelvinPerCount = 0.01;
constexpr double kLargestAutomatic = 0.5;  // K

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

double lambda_to_tune(const StreamTask& task) {
  return task.settings.auto_lambda ? kLargestAutomatic : task.lambda_half() * task.kelvin_per_value();
}

}  // namespace bolo::deblur
