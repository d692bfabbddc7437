// A capture, a still or pixel maps (.h5, .mat): any HDF5 file, whole or damaged.
#include "src/capture/capture.hpp"
#include "src/capture/pixel_maps_io.hpp"
#include "tests/fuzz/input.hpp"
#include "tests/fuzz/use_capture.hpp"

using namespace bolo;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const fuzz::InputFile file({data, bytes});
  if (const auto reader = capture::CaptureReader::open(file.name())) fuzz::use_capture(*reader);
  if (const auto reader = capture::CaptureReader::salvage(file.name())) fuzz::use_capture(*reader);
  static_cast<void>(capture::read_still(file.name()));
  static_cast<void>(capture::read_pixel_maps(file.name()));
  return 0;
}
