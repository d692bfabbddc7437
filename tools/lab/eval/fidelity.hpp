// `bolo-lab eval fidelity`: which estimator is good where.
#pragma once

namespace bolo::tools {

// argv[0] is "fidelity". Returns the exit code.
int eval_fidelity_main(int argc, char** argv);

}  // namespace bolo::tools
