// A ROS 2 recording (.mcap) from any source: reading it gives frames that rise in time, or an error.
#include <algorithm>

#include "tests/fuzz/input.hpp"
#include "tools/convert/footage.hpp"

using namespace bolo;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  constexpr std::size_t kMostFrames = 8;
  const fuzz::InputFile file({data, bytes});
  const auto footage = tools::open_mcap(file.name(), "", {});
  if (!footage) return 0;
  static_cast<void>((*footage)->extras());
  const capture::CaptureInfo& info = (*footage)->info();
  double last_s = -1.0;
  for (std::size_t i = 0; i < std::min(info.frames, kMostFrames); ++i) {
    tools::Frame frame;
    if (!(*footage)->read(i, frame)) break;
    if (frame.u16.size() + frame.f32.size() != info.format.geometry.pixels()) std::abort();
    if (i > 0 && !(frame.t_s > last_s)) std::abort();
    last_s = frame.t_s;
  }
  return 0;
}
