// `bolo-lab eval detect`: what deblurring is worth to object detectors.
#pragma once

namespace bolo::tools {

// argv[0] is "detect". Returns the exit code.
int eval_detect_main(int argc, char** argv);

}  // namespace bolo::tools
