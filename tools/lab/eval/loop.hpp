// `bolo-lab eval loop`: what a diagnosis is worth to the deblurring: camera -> diagnosis -> profile -> pipeline.
#pragma once

namespace bolo::tools {

// argv[0] is "loop". Returns the exit code.
int eval_loop_main(int argc, char** argv);

}  // namespace bolo::tools
