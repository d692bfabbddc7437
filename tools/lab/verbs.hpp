// Verbs of `bolo-lab`, one folder each, and evaluations of `bolo-lab eval`, one file each. argv[0] is the verb itself;
// they return the exit code.
#pragma once

#include <array>

#include "tools/cli/cli.hpp"

namespace bolo::tools {

int blind_main(int argc, char** argv);
int eval_detect_main(int argc, char** argv);
int eval_faults_main(int argc, char** argv);
int eval_fidelity_main(int argc, char** argv);
int eval_live_main(int argc, char** argv);
int eval_loop_main(int argc, char** argv);
int eval_loss_main(int argc, char** argv);
int eval_main(int argc, char** argv);
int eval_pixel_main(int argc, char** argv);
int eval_pulses_main(int argc, char** argv);
int lab_bench_main(int argc, char** argv);
int soak_main(int argc, char** argv);

inline constexpr std::array<Verb, 4> kLabVerbs{{
    {"eval", "measure what deblurring achieves", eval_main},
    {"blind", "check the diagnosis on captures with hidden effects", blind_main},
    {"soak", "run camera, daemon and readers for hours while everything goes wrong", soak_main},
    {"bench", "measure the solvers, and what readers cost the daemon", lab_bench_main},
}};

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
