#include "src/model/camera_profile.hpp"
#include "tests/fuzz/input.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const bolo::fuzz::InputFile file({data, bytes});
  static_cast<void>(bolo::model::read_profile(file.name()));
  return 0;
}
