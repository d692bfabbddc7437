// The verbs of `bolo-lab`, one folder each.
#pragma once

#include <array>

#include "tools/cli/verb.hpp"

namespace bolo::tools {

int blind_main(int argc, char** argv);
int eval_main(int argc, char** argv);
int lab_bench_main(int argc, char** argv);
int soak_main(int argc, char** argv);

inline constexpr std::array<Verb, 4> kLabVerbs{{
    {"eval", "measure what deblurring achieves", eval_main},
    {"blind", "check the diagnosis on captures with hidden effects", blind_main},
    {"soak", "run camera, daemon and readers for hours while everything goes wrong", soak_main},
    {"bench", "measure the solvers, and what readers cost the daemon", lab_bench_main},
}};

}  // namespace bolo::tools
