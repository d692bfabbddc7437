// Datagrams of any size, at any time, between those of a camera's stream.
#include "drivers/genicam/gvsp_assembler.hpp"
#include "tests/fuzz/input.hpp"

using namespace bolo;
using namespace bolo::genicam;

namespace {

class Output final : public gvsp::FrameOutput {
 public:
  explicit Output(const gvsp::StreamPlan& plan) : plan_(plan) {}

  void take_frame(const CameraFrame& frame) noexcept override {
    std::uint64_t sum = 0;
    for (const std::byte byte : frame.pixels) sum += std::to_integer<unsigned>(byte);
    const bool whole = frame.end == FrameEnd::kWhole;
    if (frame.pixels.size() > plan_.payload_bytes || (!whole && sum != 0) || frame.camera_ns < 0) std::abort();
  }
  void request_resend(const gvsp::ResendRequest& request) noexcept override {
    if (!plan_.resend || request.first > request.last || request.last > plan_.payload_bytes) std::abort();
  }

 private:
  const gvsp::StreamPlan& plan_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  fuzz::Input input(data, bytes);
  const auto how = input.take<std::uint8_t>();
  gvsp::StreamPlan plan;
  plan.payload_bytes = 1 + input.take_up_to(500);
  plan.packet_bytes = gvsp::kNetworkBytes + gvsp::kHeaderBytes + 13 + input.take_up_to(100);
  plan.frames = 1 + how % 8;
  plan.period_ns = 5'000'000;
  plan.ticks_per_s = (how & 8U) != 0 ? input.take<std::uint32_t>() : 0;
  plan.resend = (how & 16U) != 0;
  plan.packet_timeout_ns = 2'000'000;
  plan.retention_ns = 10'000'000;
  Output output(plan);
  pipeline::SourceStatus status;
  gvsp::Assembler assembler(plan, output, status);
  std::int64_t now_ns = 1;
  while (!input.empty()) {
    const auto step = input.take<std::uint8_t>();
    now_ns += static_cast<std::int64_t>(step >> 6U) * 1'000'000;
    const auto datagram = input.take_bytes(step & 63U);
    assembler.take(std::as_bytes(datagram), now_ns);
    if ((step & 32U) != 0) assembler.expire(now_ns);
  }
  assembler.expire(now_ns + 1'000'000'000);
  if (assembler.busy()) std::abort();
  return 0;
}
