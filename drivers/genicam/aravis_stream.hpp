// The stream of a camera that is not GigE Vision (USB3 Vision), received by Aravis.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/genicam/camera_frame.hpp"
#include "drivers/genicam/connection.hpp"
#include "drivers/genicam/gobject.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

class AravisStream {
 public:
  // Frames go to `take`, on Aravis's thread, until this goes. payload_bytes: of a frame. A priority that is refused is
  // a warning. Thread: setup.
  static Result<std::unique_ptr<AravisStream>> start(const Connection& connection, const CameraOptions& options,
                                                     std::size_t payload_bytes,
                                                     std::function<void(const CameraFrame&)> take,
                                                     std::vector<std::string>& warnings);
  ~AravisStream();
  AravisStream(const AravisStream&) = delete;
  AravisStream& operator=(const AravisStream&) = delete;

 private:
  AravisStream(int realtime_priority, std::function<void(const CameraFrame&)> take)
      : realtime_priority_(realtime_priority), take_(std::move(take)) {}

  static void on_stream(void* self, ArvStreamCallbackType type, ArvBuffer* buffer);
  void drain() noexcept;
  void await_priority(std::vector<std::string>& warnings) const;

  enum class Priority { kPending, kGranted, kRefused };

  const int realtime_priority_;
  const std::function<void(const CameraFrame&)> take_;
  std::atomic<Priority> priority_{Priority::kPending};
  std::atomic<ArvStream*> running_{nullptr};  // stream_, for the thread that Aravis starts while making it
  Ref<ArvStream> stream_;
};

}  // namespace bolo::genicam
