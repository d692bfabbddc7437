// `bolo-lab eval live`: judges a running daemon by what a reader of its shared memory sees.
#pragma once

namespace bolo::tools {

// argv[0] is "live". Returns the exit code.
int eval_live_main(int argc, char** argv);

}  // namespace bolo::tools
