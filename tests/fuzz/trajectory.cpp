// A trajectory (CSV), and the camera path made from it.
#include "src/sim/path.hpp"
#include "tests/fuzz/input.hpp"

using namespace bolo::sim;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const bolo::fuzz::InputFile file({data, bytes});
  const auto points = read_trajectory(file.name());
  if (!points) return 0;
  TrajectoryUse use;
  use.start_s = points->front().t_s;
  use.to_s = 0.1;
  use.step_s = 0.01;
  if (const auto path = follow_trajectory(*points, use)) static_cast<void>(path->bounds(0.0, 0.1));
  return 0;
}
