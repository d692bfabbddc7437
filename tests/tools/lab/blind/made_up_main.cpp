// `bolo` with two verbs.
#include <string_view>

#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/verbs.hpp"

int main(int argc, char** argv) {
  const std::string_view verb = argc > 1 ? argv[1] : "";
  if (verb == "diagnose") return bolo::tools::diagnose_main(argc - 1, argv + 1);
  if (verb == "blind") bolo::tools::set_program_name("bolo-lab");
  if (verb == "blind") return bolo::tools::blind_main(argc - 1, argv + 1);
  return 2;
}
