// Single pixels for `bolo deblur --points` (CSV).
#include "tests/fuzz/input.hpp"
#include "tools/deblur/pixel_choice.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  constexpr bolo::Geometry kFrame{64, 24};
  const bolo::fuzz::InputFile file({data, bytes});
  const auto points = bolo::tools::read_points(file.name(), kFrame);
  if (!points) return 0;
  for (const std::uint32_t point : *points) {
    if (point >= kFrame.pixels()) std::abort();
  }
  return 0;
}
