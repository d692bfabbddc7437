#include "tests/fuzz/input.hpp"
#include "tools/bolod/config.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const bolo::fuzz::InputFile file({data, bytes});
  static_cast<void>(bolo::daemon::read_config(file.name()));
  return 0;
}
