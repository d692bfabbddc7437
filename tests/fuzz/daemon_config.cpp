// The daemon's configuration.
#include "src/deblur/isa.hpp"
#include "tests/fuzz/input.hpp"
#include "tools/bolod/config.hpp"

// In place of the solver's kernels, which take ten minutes to compile as a fuzzer.
std::vector<std::string_view> bolo::deblur::available_isas() { return {"SSE2"}; }
bool bolo::deblur::force_isa(std::string_view) { return false; }

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const bolo::fuzz::InputFile file({data, bytes});
  static_cast<void>(bolo::daemon::read_config(file.name()));
  return 0;
}
