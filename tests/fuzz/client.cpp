// Hostile shared memory read through libbolo-client: reader steps first, then the object.
#include <vector>

#include "bolo/client.h"
#include "tests/fuzz/hostile_object.hpp"

using namespace bolo;

namespace {

void use_frame(bolo_client* client, const bolo_client_frame& frame) {
  const bolo_client_info& info = *bolo_client_get_info(client);
  const std::size_t pixels = std::size_t{info.width} * info.height;
  std::vector<std::uint16_t> raw(pixels);
  std::vector<std::uint16_t> deblurred(pixels);
  std::vector<float> kelvin(pixels);
  static_cast<void>(bolo_client_copy(&frame, raw.data(), deblurred.data()));
  static_cast<void>(bolo_client_kelvin(client, raw.data(), pixels, kelvin.data()));
  std::vector<bolo_shm_block_motion> blocks(std::size_t{frame.motion_across} * frame.motion_down);
  bolo_shm_motion motion{};
  static_cast<void>(bolo_client_copy_motion(&frame, &motion, blocks.data()));
  for (std::size_t i = 0; i < blocks.size(); ++i) blocks[i] = frame.motion_blocks[i];
  static_cast<void>(bolo_client_valid(&frame));
}

void take(const fuzz::Step& step, bolo_client* client, fuzz::HostileObject& object) {
  bolo_client_frame frame{};
  switch (step.what % 5) {
    case 0:
      return object.write(step.where, step.value);
    case 1:
      if (bolo_client_next(client, 0, &frame) == BOLO_CLIENT_OK) use_frame(client, frame);
      return;
    case 2:
      if (bolo_client_latest(client, 0, &frame) == BOLO_CLIENT_OK) use_frame(client, frame);
      return;
    case 3: {
      const bolo_client_point point{step.where % 64U, step.where / 64U};
      float value = 0.0F;
      static_cast<void>(bolo_client_points(client, step.value, &point, 1, &value));
      return;
    }
    default:
      static_cast<void>(bolo_client_get_state(client));
      bolo_client_hold_free(bolo_client_hold_new(client));
      return;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  static const std::string name = "fuzz-client-" + std::to_string(getpid());
  fuzz::Input input(data, bytes);
  const auto steps = fuzz::take_steps(input);
  fuzz::HostileObject object(name, input.rest());
  bolo_client* client = nullptr;
  if (bolo_client_open(name.c_str(), 0, &client) != BOLO_CLIENT_OK) return 0;
  for (const fuzz::Step& step : steps) take(step, client, object);
  bolo_client_close(client);
  return 0;
}
