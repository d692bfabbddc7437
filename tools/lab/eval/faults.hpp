// `bolo-lab eval faults`: a camera that fails in every way that its fake knows.
#pragma once

namespace bolo::tools {

// argv[0] is the evaluation. Returns the exit code. Thread: setup.
int eval_faults_main(int argc, char** argv);

}  // namespace bolo::tools
