#include "bolo/deblur/solver.hpp"

#include <cmath>

#include "src/deblur/solvers.hpp"

namespace bolo::deblur {
namespace {

constexpr double kKelvinPerCount = 0.01;

Status validate(const StreamFormat& input) {
  if (input.geometry.width < 1 || input.geometry.height < 1) return bad_input("deblur: the stream's frames are empty");
  const double scale = input.scale.scale;
  if (input.scale.unit == Unit::kKelvin && (!std::isfinite(scale) || scale == 0.0)) {
    return bad_input("deblur: the stream's scale must be a number other than 0 (kelvin a value)");
  }
  return {};
}

}  // namespace

double StreamTask::kelvin_per_value() const {
  return input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : kKelvinPerCount;
}

double StreamTask::lambda_half() const {
  const double unit = input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : 1.0;
  return settings.half_square_lambda() / unit;
}

Result<std::unique_ptr<Solver>> Solver::create(const Settings& settings, const StreamFormat& input, PixelType output) {
  if (const Status good = deblur::validate(settings); !good) return tl::unexpected<Error>(good.error());
  if (const Status good = validate(input); !good) return tl::unexpected<Error>(good.error());
  const StreamTask task{settings, input, output};
  // Without a prior any input that explains the samples is optimal; the inverse filter is the one that is constant
  // between samples. Bins longer than a frame leave no such freedom.
  const bool no_prior = settings.lambda == 0.0 && (1 << settings.levels) >= settings.window - 1;
  if (settings.method == Method::kInverse || no_prior) return make_inverse_solver(task);
  if (settings.method == Method::kExact) return make_exact_solver(task);
  return make_admm_solver(task);
}

}  // namespace bolo::deblur
