// `bolo-lab eval pixel`: one pixel, least squares against the quadratic programme (the paper's Fig. 4).
#pragma once

namespace bolo::tools {

// argv[0] is "pixel". Returns the exit code.
int eval_pixel_main(int argc, char** argv);

}  // namespace bolo::tools
