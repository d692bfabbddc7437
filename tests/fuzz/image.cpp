// A picture (PNG, JPEG, TIFF) as scene or to convert. The target is our use of the result, not the libraries' parsing.
#include "src/sim/field.hpp"
#include "tests/fuzz/input.hpp"
#include "tools/convert/picture.hpp"

using namespace bolo;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const fuzz::InputFile file({data, bytes});
  static_cast<void>(sim::read_image(file.name(), {}));
  static_cast<void>(tools::read_png_picture(file.name()));
  const auto pages = tools::count_tiff_pages(file.name());
  auto tiff = tools::TiffReader::open(file.name());
  if (tiff && pages && *pages > 0) static_cast<void>(tiff->read(*pages - 1));
  return 0;
}
