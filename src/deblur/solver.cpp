#include "bolo/deblur/solver.hpp"

#include <cmath>
#include <utility>

#include "src/deblur/auto_lambda_solver.hpp"
#include "src/deblur/method.hpp"
#include "src/deblur/mmae_solver.hpp"
#include "src/deblur/plane_solver.hpp"

namespace bolo::deblur {
namespace {

Status validate(const StreamFormat& input) {
  if (input.geometry.width < 1 || input.geometry.height < 1) return bad_input("deblur: the stream's frames are empty");
  const double scale = input.scale.scale;
  if (input.scale.unit == Unit::kKelvin && (!std::isfinite(scale) || scale == 0.0)) {
    return bad_input("deblur: the stream's scale must be a number other than 0 (kelvin a value)");
  }
  return {};
}

}  // namespace

// Without a prior any input that explains the samples is optimal; the inverse filter is the one that is constant
// between samples. Bins longer than a frame leave no such freedom.
std::unique_ptr<PixelMethod> make_method(const StreamTask& task) {
  const Settings& settings = task.settings;
  const bool no_prior = settings.lambda == 0.0 && (1 << settings.levels) >= settings.window - 1;
  if (settings.method == Method::kInverse || no_prior) return make_inverse(task);
  if (settings.method == Method::kExact) return make_exact(task);
  if (settings.method == Method::kDual) return make_dual(task);
  return make_admm(task);
}

Result<std::unique_ptr<Solver>> Solver::create(const Settings& settings, const StreamFormat& input, PixelType output,
                                               const model::PixelMaps& maps) {
  if (const Status good = deblur::validate(settings); !good) return tl::unexpected<Error>(good.error());
  if (const Status good = validate(input); !good) return tl::unexpected<Error>(good.error());
  auto correction = Correction::create(settings, input, maps);
  if (!correction) return tl::unexpected<Error>(correction.error());
  const StreamTask task{settings, input, output};
  if (settings.method == Method::kMmae) return std::make_unique<MmaeSolver>(task, std::move(*correction));
  if (settings.auto_lambda && settings.method != Method::kInverse) {
    return std::make_unique<AutoLambdaSolver>(task, std::move(*correction));
  }
  return std::make_unique<PlaneSolver>(task, std::move(*correction), make_method(task));
}

}  // namespace bolo::deblur
