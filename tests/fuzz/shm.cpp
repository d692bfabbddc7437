// Hostile shared memory read by the C++ reader and solved at single points: steps first, then the object.
#include <algorithm>
#include <array>

#include "drivers/shm/camera_block.hpp"
#include "drivers/shm/shm_reader.hpp"
#include "tests/fuzz/hostile_object.hpp"

using namespace bolo;
using namespace bolo::shm;

namespace {

unsigned sum(const BorrowedFrame& frame) {
  unsigned total = 0;
  for (std::size_t i = 0; i < frame.layout.plane_bytes / sizeof(std::uint16_t); ++i) {
    total += unsigned{frame.raw()[i]} + unsigned{frame.deblurred()[i]};
  }
  return total;
}

void take(const fuzz::Step& step, ShmReader& reader, fuzz::HostileObject& object) {
  static ReadFrame frame;
  static bolo_shm_slot head;
  static std::array<std::uint16_t, 3> samples;
  switch (step.what % 7) {
    case 0:
      return object.write(step.where, step.value);
    case 1:
      static_cast<void>(reader.read(step.value, frame, 0));
      return;
    case 2:
      if (const auto borrowed = reader.borrow(step.value)) {
        volatile unsigned seen = sum(*borrowed);
        static_cast<void>(seen);
        static_cast<void>(borrowed->still_there());
      }
      return;
    case 3:
      static_cast<void>(reader.read_samples(step.value, std::array<std::uint32_t, 3>{0, 0, 0}, head, samples.data()));
      return;
    case 4:
      if (const auto camera = reader.camera()) static_cast<void>(camera_json(*camera, monotonic_ns()));
      return;
    case 5:
      static_cast<void>(reader.header());
      static_cast<void>(reader.settings());
      static_cast<void>(reader.closed());
      static_cast<void>(reader.replaced());
      return;
    default:
      static_cast<void>(reader.wait(reader.published() - 1, 0));
      return;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  static const std::string name = "fuzz-shm-" + std::to_string(getpid());
  fuzz::Input input(data, bytes);
  const auto steps = fuzz::take_steps(input);
  fuzz::HostileObject object(name, input.rest());
  auto reader = ShmReader::open(name);
  if (!reader) return 0;
  for (const fuzz::Step& step : steps) take(step, *reader, object);
  return 0;
}
