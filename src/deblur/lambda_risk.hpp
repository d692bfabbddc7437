// Risk of each lambda on each motion model: the table from which lambda is chosen.
#pragma once

#include <array>

#include "src/deblur/method.hpp"
#include "src/deblur/mmae_kernels.hpp"
#include "src/deblur/motion_models.hpp"

namespace bolo::deblur {

// lambda_half over the noise. The first is as good as none, but says which input is meant where a frame is lost. The
// last choice is the raw sample itself: with much noise and no look-ahead no lambda reaches it.
inline constexpr std::array kLambdaSteps = {0.001F, 0.05F, 0.1F, 0.2F, 0.35F, 0.5F,  0.7F,
                                            1.0F,   1.4F,  2.0F, 3.0F, 5.0F,  10.0F, 20.0F};
inline constexpr int kRawChoice = static_cast<int>(kLambdaSteps.size());
static_assert(kRawChoice < kChoices);  // the last ones are never chosen

// Mean squared error against x at the target's time, in units of the noise's variance.
class LambdaRisk {
 public:
  // Draws samples of every model and estimates them with every choice. Some 0.1 s. Thread: setup.
  LambdaRisk(const StreamTask& task, const MotionModels& models);

  // The choices with the least risk under the posterior probabilities of some blocks. Thread: worker.
  std::array<int, kStatBlocks> best(const Posteriors& posteriors, int blocks) const noexcept;

 private:
  RiskTable risk_;
  const MmaeKernels& kernels_;
};

}  // namespace bolo::deblur
