// A camera's calibration constants and parameters, and the temperature table made from them.
#include "drivers/genicam/radiometry.hpp"
#include "tests/fuzz/input.hpp"

using namespace bolo::genicam;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  bolo::fuzz::Input input(data, bytes);
  Planck planck;
  for (double* value : {&planck.r, &planck.b, &planck.f, &planck.j0, &planck.j1}) *value = input.take<double>();
  if (kelvin_table(planck, {}).size() != 65536) std::abort();
  return 0;
}
