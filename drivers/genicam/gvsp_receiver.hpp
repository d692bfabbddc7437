// Socket of a GigE Vision stream and its receiving thread.
#pragma once

#include <netinet/in.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "drivers/genicam/gvsp_assembler.hpp"
#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::genicam::gvsp {

// Requests SCHED_FIFO at this priority or, for 0, nice level -10 (a refusal is no error). Thread: the thread concerned.
Status raise_priority(const std::string& name, int realtime_priority);

// Warning text for a refused priority. Thread: any.
std::string refused_priority(int realtime_priority);

class Receiver final : private FrameOutput {
 public:
  // Binds a socket that only accepts packets from the camera's address. Dotted addresses. Thread: setup.
  static Result<std::unique_ptr<Receiver>> open(const std::string& own_address, const std::string& camera_address,
                                                int socket_buffer_bytes);
  // Ends the thread within one frame's work. Thread: setup.
  ~Receiver();

  // UDP port that the camera sends to.
  std::uint16_t port() const noexcept { return port_; }

  // Starts delivering frames to `take` on the receiver's thread. source_port: of the camera's packets; 0: unknown.
  // Returns whether the priority was granted; frames flow in any case. Thread: setup, once.
  Status start(const StreamPlan& plan, std::uint16_t source_port, int realtime_priority,
               std::function<void(const CameraFrame&)> take, std::shared_ptr<pipeline::SourceStatus> status);

 private:
  explicit Receiver(UniqueFd socket, const sockaddr_in& camera) : socket_(std::move(socket)), camera_(camera) {}

  void run() noexcept;
  void pause(std::int64_t rest_ns) const noexcept;
  void take_frame(const CameraFrame& frame) noexcept override { take_(frame); }
  void request_resend(const ResendRequest& request) noexcept override;

  const UniqueFd socket_;
  const sockaddr_in camera_;  // its control port
  std::uint16_t port_ = 0;
  UniqueFd wake_;
  std::uint16_t request_id_ = 0;
  StreamPlan plan_;
  double pause_share_ = 0.0;  // of a frame's remaining time
  std::function<void(const CameraFrame&)> take_;
  std::shared_ptr<pipeline::SourceStatus> status_;
  std::unique_ptr<Assembler> assembler_;
  std::vector<std::byte> bytes_;  // of a batch of datagrams
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace bolo::genicam::gvsp
