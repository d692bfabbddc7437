// The paper's problem with a lambda that follows noise and motion.
#pragma once

#include <array>
#include <memory>

#include "src/deblur/method.hpp"
#include "src/deblur/mmae_kernels.hpp"
#include "src/deblur/motion_posterior.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::deblur {

// --- Risk of each lambda on each motion model: the table that lambda is chosen from.

// lambda_half over the noise. The first is almost no prior, but makes the input unique where a frame is lost. The last
// choice is the raw sample itself: with much noise and no look-ahead no lambda reaches it.
inline constexpr std::array kLambdaSteps = {0.001F, 0.05F, 0.1F, 0.2F, 0.35F, 0.5F,  0.7F,
                                            1.0F,   1.4F,  2.0F, 3.0F, 5.0F,  10.0F, 20.0F};
inline constexpr int kRawChoice = static_cast<int>(kLambdaSteps.size());
static_assert(kRawChoice < kChoices);  // the remaining ones are never chosen

// Mean squared error against x at the target's time, in units of the noise's variance.
class LambdaRisk {
 public:
  // Estimates samples drawn from every model with every choice. Some 0.1 s. Thread: setup.
  LambdaRisk(const StreamTask& task, const MotionModels& models);

  // The choices with the least risk under the posterior probabilities of `blocks` blocks. Thread: worker.
  std::array<int, kStatBlocks> best(const Posteriors& posteriors, int blocks) const noexcept;

 private:
  RiskTable risk_;
  const MmaeKernels& kernels_;
};

// In each block of 8 x 8 pixels the lambda with the least expected error, given how well the models of motion explain
// the block (MotionPosterior) and the error of each lambda on each model (LambdaRisk). A raw sample of less expected
// error is published unchanged: an addition to the paper's estimator.
class AutoLambdaSolver final : public Solver {
 public:
  explicit AutoLambdaSolver(const StreamTask& task);

  void prepare(const WindowView& window, Crew& crew) noexcept override;
  void solve(const WindowView& window, const Region& part, void* out) const noexcept override;
  void solve_points(const WindowView& window, std::span<const std::uint32_t> pixels, void* out) const noexcept override;
  int iterations() const noexcept override { return method_->iterations(); }
  std::string_view isa() const noexcept override { return method_->isa(); }
  double noise_k() const noexcept override;
  bool set_noise(double noise_k) noexcept override;
  double measured_noise_k() const noexcept override;

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
