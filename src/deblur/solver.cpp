#include "src/deblur/solver.hpp"

#include <cmath>
#include <sstream>

#include "src/deblur/auto_lambda_solver.hpp"
#include "src/deblur/grid.hpp"
#include "src/deblur/method.hpp"
#include "src/deblur/mmae_solver.hpp"
#include "src/deblur/motion_solver.hpp"
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

Status check_row_delay(const Settings& settings, const StreamFormat& input, double row_delay_s) {
  const double span_s = row_delay_s * input.row_step * (input.geometry.height - 1);
  if (std::isfinite(span_s) && std::abs(span_s) <= (settings.window - 1) * settings.period_s) return {};
  std::ostringstream text;
  text << "row_delay_s is " << row_delay_s << ": reading " << input.geometry.height
       << " rows would take longer than the window of " << settings.window << " frames";
  return bad_input(text.str());
}

}  // namespace

// Without a prior any input that explains the samples is optimal; the inverse filter is the one that is constant
// between samples. Bins longer than a frame leave no such freedom.
std::unique_ptr<PixelMethod> make_method(const StreamTask& task) {
  const Settings& settings = task.settings;
  const bool no_prior = settings.lambda == 0.0 && (1 << settings.levels) >= settings.window - 1;
  if (settings.method == Method::kInverse || no_prior) return make_inverse(task);
  if (settings.method == Method::kExact) return make_exact(task);
  if (reduce(settings, 1.0).parts > 1) return make_interior(task);
  if (settings.method == Method::kDual) return make_dual(task);
  return make_admm(task);
}

Result<std::unique_ptr<Solver>> Solver::create(const Settings& settings, const StreamFormat& input, PixelType output,
                                               double row_delay_s) {
  if (const Status good = deblur::validate(settings); !good) return tl::unexpected<Error>(good.error());
  if (const Status good = validate(input); !good) return tl::unexpected<Error>(good.error());
  if (const Status good = check_row_delay(settings, input, row_delay_s); !good) {
    return tl::unexpected<Error>(good.error());
  }
  const StreamTask task{settings, input, output, row_delay_s * input.row_step / settings.period_s};
  if (settings.method == Method::kMmae) return std::make_unique<MmaeSolver>(task);
  if (settings.method == Method::kMotion) return std::make_unique<MotionSolver>(task);
  if (settings.auto_lambda && settings.method != Method::kInverse) {
    return std::make_unique<AutoLambdaSolver>(task);
  }
  return std::make_unique<PlaneSolver>(task, make_method(task));
}

}  // namespace bolo::deblur
