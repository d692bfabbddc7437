#include "drivers/genicam/aravis_stream.hpp"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "drivers/genicam/gvsp_receiver.hpp"
#include "drivers/genicam/network.hpp"
#include "src/core/clock.hpp"

namespace bolo::genicam {
namespace {

constexpr int kFewestBuffers = 40;
constexpr std::int64_t kOldestNs = 1'000'000'000;  // a frame takes less than this from its first packet to here

// Arrival of the first packet, on CLOCK_MONOTONIC. Aravis notes it on the wall clock, in whole microseconds; the
// clocks' present distance is applied. A step of the wall clock within the frame is an error of that size; an
// implausible time is replaced by the present.
std::int64_t first_packet_ns(ArvBuffer* buffer) noexcept {
  const auto system_ns = static_cast<std::int64_t>(arv_buffer_get_system_timestamp(buffer));
  const std::int64_t now_ns = monotonic_ns();
  const std::int64_t age_ns = realtime_ns() - system_ns;
  return age_ns >= 0 && age_ns < kOldestNs ? now_ns - age_ns : now_ns;
}

FrameEnd end_of(ArvBuffer* buffer) noexcept {
  switch (arv_buffer_get_status(buffer)) {
    case ARV_BUFFER_STATUS_SUCCESS:
      return FrameEnd::kWhole;
    case ARV_BUFFER_STATUS_UNKNOWN:
    case ARV_BUFFER_STATUS_CLEARED:
    case ARV_BUFFER_STATUS_FILLING:
    case ARV_BUFFER_STATUS_ABORTED:
      return FrameEnd::kDriver;
    default:  // later versions of Aravis know more ways to fail
      return FrameEnd::kIncomplete;
  }
}

CameraFrame frame_of(ArvBuffer* buffer) noexcept {
  CameraFrame frame;
  frame.end = end_of(buffer);
  frame.id = arv_buffer_get_frame_id(buffer);
  if (frame.end != FrameEnd::kWhole || frame.id == CameraFrame::kNoId) return frame;
  frame.camera_ns = static_cast<std::int64_t>(arv_buffer_get_timestamp(buffer));
  frame.receive_ns = first_packet_ns(buffer);
  frame.mono16 = arv_buffer_get_payload_type(buffer) == ARV_BUFFER_PAYLOAD_TYPE_IMAGE &&
                 arv_buffer_get_image_pixel_format(buffer) == ARV_PIXEL_FORMAT_MONO_16;
  if (!frame.mono16) return frame;
  int y_padding = 0;
  std::size_t size = 0;
  const void* data = arv_buffer_get_image_data(buffer, &size);
  arv_buffer_get_image_padding(buffer, &frame.x_padding, &y_padding);
  frame.width = arv_buffer_get_image_width(buffer);
  frame.height = arv_buffer_get_image_height(buffer);
  frame.pixels = {static_cast<const std::byte*>(data), data != nullptr ? size : 0};
  return frame;
}

}  // namespace

Result<std::unique_ptr<AravisStream>> AravisStream::start(const Connection& connection, const CameraOptions& options,
                                                          std::size_t payload_bytes,
                                                          std::function<void(const CameraFrame&)> take,
                                                          std::vector<std::string>& warnings) {
  RETURN_IF_ERROR(check_resources());
  std::unique_ptr<AravisStream> made(new AravisStream(options.realtime_priority, std::move(take)));
  GlibError error;
  made->stream_.reset(
      arv_device_create_stream(connection.device.get(), &AravisStream::on_stream, made.get(), error.out()));
  if (error || made->stream_ == nullptr) return failed(connection.name + ": no stream (" + error.message() + ")");
  made->running_.store(made->stream_.get(), std::memory_order_release);  // partner: drain()
  made->await_priority(warnings);
  for (int i = 0; i < std::max(options.buffers, kFewestBuffers); ++i) {
    ArvBuffer* buffer = arv_buffer_new_allocate(payload_bytes);
    arv_buffer_set_frame_id(buffer, CameraFrame::kNoId);
    arv_stream_push_buffer(made->stream_.get(), buffer);
  }
  return made;
}

AravisStream::~AravisStream() {
  running_.store(nullptr, std::memory_order_release);  // partner: drain(); buffers are not turned round any more
}

// --- Aravis's thread ---

void AravisStream::on_stream(void* self, ArvStreamCallbackType type, ArvBuffer*) {
  auto* stream = static_cast<AravisStream*>(self);
  if (type == ARV_STREAM_CALLBACK_TYPE_INIT) {
    const Status granted = gvsp::raise_priority("", stream->realtime_priority_);
    stream->priority_.store(granted ? Priority::kGranted : Priority::kRefused,
                            std::memory_order_release);  // partner: await_priority()
  }
  if (type == ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE) stream->drain();
}

// The buffer that is done is in the output queue already: take it, use it, give it back at once.
void AravisStream::drain() noexcept {
  ArvStream* stream = running_.load(std::memory_order_acquire);  // partner: start()
  if (stream == nullptr) return;
  while (ArvBuffer* buffer = arv_stream_try_pop_buffer(stream)) {
    take_(frame_of(buffer));
    // Overwritten by the frame's first packet only: a frame that comes back with it has lost that packet.
    arv_buffer_set_frame_id(buffer, CameraFrame::kNoId);
    arv_stream_push_buffer(stream, buffer);
  }
}

// The thread sets its priority first thing; waits for that so that a refusal is known.
void AravisStream::await_priority(std::vector<std::string>& warnings) const {
  constexpr int kTries = 1000;
  for (int i = 0; i < kTries; ++i) {
    if (priority_.load(std::memory_order_acquire) != Priority::kPending) break;  // partner: on_stream()
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  if (priority_.load(std::memory_order_acquire) == Priority::kRefused) {  // partner: on_stream()
    warnings.push_back(gvsp::refused_priority(realtime_priority_));
  }
}

}  // namespace bolo::genicam
