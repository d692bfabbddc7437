// `bolo-lab`: measures and tries Bolo itself; never installed, never needed by bolo or bolod.
#include "tools/cli/cli.hpp"
#include "tools/lab/verbs.hpp"

int bolo::tools::eval_main(int argc, char** argv) {
  return dispatch({"bolo-lab eval", "measurements of what the deblurring achieves"}, kEvaluations, argc, argv);
}

int main(int argc, char** argv) {
  return bolo::tools::dispatch({"bolo-lab", "the laboratory: what Bolo achieves, measured"}, bolo::tools::kLabVerbs,
                               argc, argv);
}
