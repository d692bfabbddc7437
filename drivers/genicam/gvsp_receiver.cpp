#include "drivers/genicam/gvsp_receiver.hpp"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <future>
#include <utility>

#include "drivers/genicam/network.hpp"
#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"
#include "src/rt/thread.hpp"

namespace bolo::genicam::gvsp {
namespace {

constexpr std::size_t kBatch = 32;  // datagrams per system call
constexpr std::int64_t kIdleNs = 1'000'000'000;
constexpr int kNiceLevel = -10;
constexpr long kLeastPauseNs = 100'000;  // twice the lateness of a sleep
constexpr long kMostPauseNs = 2'000'000;
// Share of a frame's expected remaining time. A larger one would propagate a late read to the next frame: the lateness
// of the sleep, divided by 1 - share, replaces the frame's length.
constexpr double kMostPauseShare = 0.75;

}  // namespace

Status raise_priority(const std::string& name, int realtime_priority) {
  if (realtime_priority == 0) setpriority(PRIO_PROCESS, 0, kNiceLevel);  // Linux: this thread only
  return rt::apply_to_this_thread({name, realtime_priority});
}

std::string refused_priority(int realtime_priority) {
  return "asked for real-time priority " + std::to_string(realtime_priority) +
         " of the receiving thread, refused: raise LimitRTPRIO (systemd) or ulimit -r";
}

Result<std::unique_ptr<Receiver>> Receiver::open(const std::string& own_address, const std::string& camera_address,
                                                 int socket_buffer_bytes) {
  UniqueFd fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in own = address_of(own_address, 0);
  socklen_t size = sizeof own;
  // Install the filter first: packets received before it would stay in the socket.
  if (!fd || !filter_stream(fd.get(), camera_address, 0) ||
      bind(fd.get(), reinterpret_cast<const sockaddr*>(&own), size) != 0 ||
      getsockname(fd.get(), reinterpret_cast<sockaddr*>(&own), &size) != 0) {
    return failed("no socket for the stream on " + own_address + " (" + std::strerror(errno) + ")");
  }
  setsockopt(fd.get(), SOL_SOCKET, SO_RCVBUF, &socket_buffer_bytes, sizeof socket_buffer_bytes);
  std::unique_ptr<Receiver> receiver(new Receiver(std::move(fd), address_of(camera_address, kGvcpPort)));
  receiver->port_ = ntohs(own.sin_port);
  receiver->wake_ = UniqueFd(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  return receiver;
}

Receiver::~Receiver() {
  if (!thread_.joinable()) return;
  stop_.store(true, std::memory_order_release);  // partner: run()
  eventfd_write(wake_.get(), 1);
  thread_.join();
}

Status Receiver::start(const StreamPlan& plan, std::uint16_t source_port, int realtime_priority,
                       std::function<void(const CameraFrame&)> take, std::shared_ptr<pipeline::SourceStatus> status) {
  if (source_port != 0) {
    std::array<char, INET_ADDRSTRLEN> text{};
    inet_ntop(AF_INET, &camera_.sin_addr, text.data(), text.size());
    filter_stream(socket_.get(), text.data(), source_port);
  }
  plan_ = plan;
  // Packets take up to twice their size in the socket buffer; keep half of it free.
  int buffer = 0;
  socklen_t size = sizeof buffer;
  getsockopt(socket_.get(), SOL_SOCKET, SO_RCVBUF, &buffer, &size);
  pause_share_ = std::min(kMostPauseShare, buffer / (4.0 * static_cast<double>(plan.payload_bytes + 1)));
  take_ = std::move(take);
  status_ = std::move(status);
  FrameOutput& output = *this;
  assembler_ = std::make_unique<Assembler>(plan, output, *status_);
  bytes_.resize(kBatch * plan.packet_bytes);
  std::promise<Status> granted;
  std::future<Status> answer = granted.get_future();
  thread_ = std::thread([this, realtime_priority, granted = std::move(granted)]() mutable {
    granted.set_value(raise_priority("gvsp", realtime_priority));
    prctl(PR_SET_TIMERSLACK, 1UL);  // ns, instead of 50 us
    run();
  });
  return answer.get();
}

void Receiver::run() noexcept {
  std::array<iovec, kBatch> parts{};
  std::array<mmsghdr, kBatch> messages{};
  for (std::size_t i = 0; i < kBatch; ++i) {
    parts[i] = {bytes_.data() + i * plan_.packet_bytes, plan_.packet_bytes};
    messages[i].msg_hdr.msg_iov = &parts[i];
    messages[i].msg_hdr.msg_iovlen = 1;
  }
  while (!stop_.load(std::memory_order_acquire)) {  // partner: ~Receiver()
    std::array<pollfd, 2> events{{{socket_.get(), POLLIN, 0}, {wake_.get(), POLLIN, 0}}};
    const std::int64_t wait_ns = assembler_->busy() ? std::min(plan_.packet_timeout_ns, kIdleNs) : kIdleNs;
    const timespec wait{static_cast<time_t>(wait_ns / 1'000'000'000), static_cast<long>(wait_ns % 1'000'000'000)};
    ppoll(events.data(), events.size(), &wait, nullptr);
    const int count = recvmmsg(socket_.get(), messages.data(), kBatch, MSG_DONTWAIT, nullptr);
    const std::int64_t now_ns = monotonic_ns();
    for (int i = 0; i < count; ++i) {
      const mmsghdr& message = messages[static_cast<std::size_t>(i)];
      const auto* bytes = static_cast<const std::byte*>(message.msg_hdr.msg_iov->iov_base);
      // A datagram longer than agreed is truncated, and treated as invalid.
      const bool cut = (message.msg_hdr.msg_flags & MSG_TRUNC) != 0;
      assembler_->take({bytes, cut ? 0 : message.msg_len}, now_ns);
    }
    assembler_->expire(now_ns);
    if (count < static_cast<int>(kBatch)) pause(assembler_->rest_ns(now_ns));  // the socket is empty
  }
}

// Sleeps through most of a frame's remaining time, without delaying its last packet: two or three wake-ups per frame.
void Receiver::pause(std::int64_t rest_ns) const noexcept {
  const auto pause_ns = static_cast<long>(pause_share_ * static_cast<double>(rest_ns));
  if (pause_ns < kLeastPauseNs) return;
  const timespec time{0, std::min(pause_ns, kMostPauseNs)};
  nanosleep(&time, nullptr);
}

// Sends GVCP's PACKETRESEND command, without acknowledge, from the stream's port.
void Receiver::request_resend(const ResendRequest& request) noexcept {
  constexpr unsigned kKey = 0x42;
  constexpr unsigned kResendExtendedIds = 0x10;
  constexpr unsigned kPacketResend = 0x0040;
  request_id_ = request_id_ == 0xffff ? std::uint16_t{1} : static_cast<std::uint16_t>(request_id_ + 1);
  std::array<std::uint8_t, 28> message{};
  const std::size_t bytes = request.extended ? 28 : 20;
  const std::uint32_t ids = request.extended ? ~std::uint32_t{0} : kShortPacketId;
  store_u16(message, 0, kKey << 8U | (request.extended ? kResendExtendedIds : 0U));
  store_u16(message, 2, kPacketResend);
  store_u16(message, 4, static_cast<std::uint32_t>(bytes - 8));
  store_u16(message, 6, request_id_);
  if (!request.extended) store_u16(message, 10, static_cast<std::uint32_t>(request.frame_id));
  store_u32(message, 12, request.first & ids);
  store_u32(message, 16, request.last & ids);
  store_u32(message, 20, static_cast<std::uint32_t>(request.frame_id >> 32U));
  store_u32(message, 24, static_cast<std::uint32_t>(request.frame_id));
  sendto(socket_.get(), message.data(), bytes, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&camera_),
         sizeof camera_);
}

}  // namespace bolo::genicam::gvsp
