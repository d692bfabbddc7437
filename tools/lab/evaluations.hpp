// The evaluations of `bolo-lab eval`, one file each.
#pragma once

#include <array>

#include "tools/cli/verb.hpp"
#include "tools/lab/detect/verb.hpp"
#include "tools/lab/eval/faults.hpp"
#include "tools/lab/eval/fidelity.hpp"
#include "tools/lab/eval/live.hpp"
#include "tools/lab/eval/loop.hpp"
#include "tools/lab/eval/loss.hpp"
#include "tools/lab/eval/pixel.hpp"
#include "tools/lab/eval/pulses.hpp"

namespace bolo::tools {

inline constexpr std::array<Verb, 8> kEvaluations{
    {{"live", "a running daemon against the truth of the capture that its fake camera replays", eval_live_main},
     {"pulses", "tau from pulses, with its interval, over many simulated recordings", eval_pulses_main},
     {"pixel", "one pixel: least squares against the quadratic programme", eval_pixel_main},
     {"fidelity", "every estimator against the truth, over speeds, noises and look-ahead", eval_fidelity_main},
     {"detect", "what deblurring is worth to object detectors, against baselines", eval_detect_main},
     {"loop", "each effect diagnosed, and undone as diagnosed: what that is worth", eval_loop_main},
     {"faults", "a camera that fails: what is lost, what is counted, how long it takes to recover", eval_faults_main},
     {"loss", "lost packets: frame rate, latency and error, with and without asking again", eval_loss_main}}};

}  // namespace bolo::tools
