// Packets to the fake camera's control server, from two peers, over time.
#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/network.hpp"
#include "src/core/frame.hpp"
#include "tests/fuzz/input.hpp"

using namespace bolo;
using namespace bolo::fakecam;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  constexpr Geometry kSensor{64, 24};
  static const RegisterMap kBlank(description());
  RegisterMap registers = kBlank;
  Counters counters;
  StreamFormat format;
  format.geometry = kSensor;
  bool streaming = false;
  CameraFeatures features(registers, counters, format, kSensor, 200.0,
                          {[&] {
                             streaming = true;
                             return gvcp::Status::kSuccess;
                           },
                           [&] { streaming = false; }, [&] { return streaming; }, [] {}});
  fill_bootstrap(registers, {"1234", 0x7f000001, 0xff000000});
  CommandHandler handler(registers, counters, {[](const ResendRequest&) {}, [&] { streaming = false; }});
  fuzz::Input input(data, bytes);
  std::int64_t now_ns = 0;
  while (!input.empty()) {
    const auto how = input.take<std::uint8_t>();
    now_ns += static_cast<std::int64_t>(how >> 4U) * 100'000'000;
    const Peer peer{0x7f000001, static_cast<std::uint16_t>(5000 + (how & 1U))};
    const auto packet = input.take_bytes(input.take<std::uint8_t>());
    if ((how & 2U) != 0) {
      static_cast<void>(handler.handle_broadcast(packet, peer, now_ns));
    } else {
      static_cast<void>(handler.handle(packet, peer, now_ns));
    }
    if (!features.region().inside(kSensor) || !(features.rate_hz() >= 0.0)) std::abort();
  }
  return 0;
}
