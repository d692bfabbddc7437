// `bolo`: the command line.
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

int main(int argc, char** argv) {
  return bolo::tools::dispatch({"bolo", "sharp frames from moving thermal cameras"}, bolo::tools::kVerbs, argc, argv);
}
