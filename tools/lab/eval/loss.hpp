// `bolo-lab eval loss`: what lost packets cost.
#pragma once

namespace bolo::tools {

// argv[0] is the evaluation. Returns the exit code. Thread: setup.
int eval_loss_main(int argc, char** argv);

}  // namespace bolo::tools
