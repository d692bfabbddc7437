// `bolo-lab eval pulses`: how well tau comes out of pulses (the paper's Fig. 3), over many simulated recordings.
#pragma once

namespace bolo::tools {

// argv[0] is "pulses". Returns the exit code.
int eval_pulses_main(int argc, char** argv);

}  // namespace bolo::tools
