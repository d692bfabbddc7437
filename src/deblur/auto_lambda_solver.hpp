// The paper's problem with a lambda that follows noise and motion.
#pragma once

#include <memory>

#include "src/deblur/lambda_risk.hpp"
#include "src/deblur/motion_posterior.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::deblur {

// In each block of 8 x 8 pixels the lambda with the least expected error, given how well the models of motion explain
// the block (MotionPosterior) and what each lambda costs on each model (LambdaRisk). Where the raw sample is expected
// to be better than any lambda makes it, it is published as it is: an addition to the paper's estimator.
class AutoLambdaSolver final : public Solver {
 public:
  explicit AutoLambdaSolver(const StreamTask& task);

  void prepare(const WindowView& window) noexcept override;
  void solve(const WindowView& window, const Region& part, void* out) const noexcept override;
  void solve_points(const WindowView& window, std::span<const std::uint32_t> pixels, void* out) const noexcept override;
  int iterations() const noexcept override { return method_->iterations(); }
  std::string_view isa() const noexcept override { return method_->isa(); }
  double noise_k() const noexcept override;

 private:
  void solve_blocks(const WindowView& window, const Region& part, std::byte* out, std::size_t stride) const noexcept;
  void solve_row(const WindowView& window, const Region& part, const int* choice, std::byte* out) const noexcept;

  StreamTask task_;
  Grid grid_;
  MotionPosterior posterior_;
  LambdaRisk risk_;
  std::unique_ptr<PixelMethod> method_;
  Pattern pattern_;
  PixelRun run_;
};

}  // namespace bolo::deblur
