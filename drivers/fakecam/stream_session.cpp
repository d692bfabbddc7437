#include "drivers/fakecam/stream_session.hpp"

#include <pthread.h>
#include <sys/prctl.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <system_error>
#include <utility>

#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

void pause_ns(std::uint64_t ns) {
  if (ns == 0) return;
  const timespec span{static_cast<time_t>(ns / 1'000'000'000U), static_cast<long>(ns % 1'000'000'000U)};
  clock_nanosleep(CLOCK_MONOTONIC, 0, &span, nullptr);
}

constexpr std::size_t kAheadFrames = 16;
constexpr std::size_t kBurstBytes = 32 << 10;  // a burst is at least one packet
constexpr std::uint64_t kLateNs = 1'000'000;
constexpr std::int64_t kStopCheckNs = 20'000'000;

PacketRoute without_gaps(PacketRoute route) {
  route.burst_gap_ns = 0;
  route.packet_delay_ns = 0;
  return route;
}

}  // namespace

PacketTrain::PacketTrain(const PacketRoute& route, Counters& counters, PacketFaults faults)
    : route_(route), counters_(counters), faults_(std::move(faults)) {
  for (std::size_t n = 0; n < kBatch; ++n) {
    parts_[n][0].iov_base = headers_[n].data();
    auto& message = messages_[n].msg_hdr;
    message.msg_name = &route_.destination;
    message.msg_namelen = sizeof(route_.destination);
    message.msg_iov = parts_[n].data();
  }
}

std::size_t PacketTrain::prepare(std::size_t n, const WireFrame& frame, const gvsp::PacketLayout& layout,
                                 const PlannedPacket& packet) noexcept {
  const std::uint32_t packet_id = packet.id;
  auto& [head, body] = parts_[n];
  body = {nullptr, 0};
  if (packet.garbage != 0) {
    head.iov_len = PacketFaults::write_garbage(packet, frame.block.block_id, headers_[n]);
  } else if (packet_id == 0) {
    gvsp::write_leader(headers_[n], frame.block);
    head.iov_len = gvsp::kLeaderBytes;
  } else if (packet_id + 1 == layout.packets()) {
    gvsp::write_trailer(headers_[n], frame.block, packet_id);
    head.iov_len = gvsp::kTrailerBytes;
  } else {
    gvsp::write_header(headers_[n], gvcp::Status::kSuccess, frame.block.block_id, gvsp::Content::kPayload, packet_id);
    head.iov_len = gvsp::kHeaderBytes;
    const std::size_t from = (packet_id - 1) * layout.data_bytes;
    // sendmmsg only reads; iovec has no const variant.
    auto* payload = reinterpret_cast<std::uint8_t*>(const_cast<std::uint16_t*>(frame.counts.data()));
    body = {payload + from, std::min(layout.data_bytes, layout.payload_bytes - from)};
  }
  messages_[n].msg_hdr.msg_iovlen = body.iov_len == 0 ? 1 : 2;
  return head.iov_len + body.iov_len;
}

std::uint32_t PacketTrain::flush(std::size_t count) noexcept {
  std::uint32_t taken = 0;
  for (std::size_t from = 0; from < count;) {
    const int n = sendmmsg(route_.socket, &messages_[from], static_cast<unsigned>(count - from), 0);
    if (n > 0) {
      taken += static_cast<std::uint32_t>(n);
      from += static_cast<std::size_t>(n);
    } else if (errno != EINTR) {  // this packet is refused (size, route, memory): go on with the next
      counters_.add(&FakeCameraStats::send_errors);
      ++from;
    }
  }
  counters_.add(&FakeCameraStats::packets_sent, taken);
  return taken;
}

std::uint32_t PacketTrain::send(const WireFrame& frame, std::uint32_t first, std::uint32_t last) noexcept {
  const auto layout = gvsp::PacketLayout::of(frame.payload_bytes(), route_.packet_size);
  const std::uint32_t end = std::min(last, layout.packets() - 1) + 1;
  const auto plan = faults_.plan(frame, first, end);
  std::uint32_t taken = faults_.lost();
  for (std::size_t next = 0; next < plan.size();) {
    std::size_t count = 0;
    for (std::size_t bytes = 0; next < plan.size() && count < kBatch && bytes < kBurstBytes; ++count, ++next) {
      bytes += prepare(count, frame, layout, plan[next]);
    }
    taken += flush(count);
    if (next < plan.size()) pause_ns(std::max<std::uint64_t>(route_.burst_gap_ns, count * route_.packet_delay_ns));
  }
  return taken;
}

void PacketTrain::send_unavailable(std::uint16_t block_id, std::uint32_t packet_id) noexcept {
  gvsp::write_header(headers_[0], gvcp::Status::kPacketUnavailable, block_id, gvsp::Content::kPayload, packet_id);
  parts_[0][0].iov_len = gvsp::kHeaderBytes;
  messages_[0].msg_hdr.msg_iovlen = 1;
  flush(1);
}

StreamSession::StreamSession(const StreamPlan& plan, const FrameProvider& provider, Counters& counters,
                             const StreamFaults& faults)
    : plan_(plan),
      provider_(provider),
      counters_(counters),
      faults_(faults),
      timeline_(provider.frame_ids, provider.times_s, provider.format.frame_period_s, plan.rate_hz),
      converter_(provider.format, plan.ir_format, plan.region),
      ring_(kAheadFrames, plan.keep_frames, Geometry{plan.region.width, plan.region.height}.pixels()),
      train_(plan.route, counters, PacketFaults(faults.tallies, faults.period_ns, plan.fault_clock_ns, false)),
      resend_train_(without_gaps(plan.route), counters,
                    PacketFaults(faults.tallies, faults.period_ns, plan.fault_clock_ns, true)),
      first_timestamp_ns_(timeline_.at(0).timestamp_ns) {
  loader_ = std::thread([this] { load_frames(); });
  try {
    sender_ = std::thread([this] { send_frames(); });
  } catch (const std::system_error&) {
    stop();
    throw;
  }
  counters_.add(&FakeCameraStats::streams_started);
}

StreamSession::~StreamSession() { stop(); }

void StreamSession::stop() noexcept {
  stop_requested_.store(true, std::memory_order_relaxed);
  ring_.close();
  if (loader_.joinable()) loader_.join();
  if (sender_.joinable()) sender_.join();
}

void StreamSession::load_frames() {
  pthread_setname_np(pthread_self(), "fakecam-load");
  const auto& format = provider_.format;
  std::vector<std::byte> plane(plane_bytes(format.geometry, format.type));
  for (std::uint64_t sequence = 0; plan_.frames == 0 || sequence < plan_.frames; ++sequence) {
    WireFrame* frame = ring_.begin_write();
    if (frame == nullptr) return;
    const Moment moment = timeline_.at(sequence);
    if (auto status = provider_.read(moment.index, plane.data()); !status) {
      result_ = status;
      break;
    }
    fill(*frame, moment, plane.data());
    ring_.end_write();
  }
  ring_.finish();
}

void StreamSession::fill(WireFrame& frame, const Moment& moment, const std::byte* plane) {
  converter_.convert(plane, frame.counts.data());
  frame.block = {block_id_of(moment.frame_id), moment.timestamp_ns, plan_.shown};
  frame.due_ns = static_cast<std::int64_t>(moment.timestamp_ns - first_timestamp_ns_);
  faults_.of_frames.apply(
      frame, {plan_.fault_clock_ns + frame.due_ns, moment.frame_id, Geometry{plan_.region.width, plan_.region.height},
              counts_per_kelvin(plan_.ir_format)});
}

void StreamSession::send_frames() {
  pthread_setname_np(pthread_self(), "fakecam-send");
  counters_.change([](FakeCameraStats& stats) { stats.streaming = true; });
  prctl(PR_SET_TIMERSLACK, 1UL);  // ns: the default of 50 us is longer than the gaps between bursts
  std::int64_t start_ns = 0;
  while (const WireFrame* frame = ring_.begin_send()) {
    if (start_ns == 0) {
      start_ns = monotonic_ns();
      start_ns_.store(start_ns, std::memory_order_relaxed);
    }
    const std::int64_t due_ns = start_ns + frame->due_ns;
    if (!wait_until(due_ns)) break;
    faults_.tallies.add_frame(frame->hit, frame->struck);
    const auto late_ns = static_cast<std::uint64_t>(std::max<std::int64_t>(monotonic_ns() - due_ns, 0));
    if (!frame->withheld) train_.send(*frame);
    counters_.change([&](FakeCameraStats& stats) {
      ++stats.position.turns;
      stats.position.timestamp_ns = frame->block.timestamp_ns;
      if (frame->withheld) return;
      ++stats.frames_sent;
      if (late_ns > kLateNs) ++stats.late_frames;
      stats.worst_lateness_ns = std::max(stats.worst_lateness_ns, late_ns);
    });
    ring_.end_send();
  }
  counters_.change([this](FakeCameraStats& stats) {
    if (!stop_requested_.load(std::memory_order_relaxed)) ++stats.streams_finished;
    stats.streaming = false;
  });
  running_.store(false, std::memory_order_release);  // pairs with running()
}

bool StreamSession::wait_until(std::int64_t due_ns) noexcept {
  while (!stop_requested_.load(std::memory_order_relaxed)) {
    const std::int64_t now_ns = monotonic_ns();
    if (now_ns >= due_ns) return true;
    const std::int64_t until_ns = std::min(due_ns, now_ns + kStopCheckNs);
    const timespec until{static_cast<time_t>(until_ns / 1'000'000'000), static_cast<long>(until_ns % 1'000'000'000)};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  }
  return false;
}

void StreamSession::resend(std::uint16_t block_id, std::uint32_t first, std::uint32_t last) noexcept {
  counters_.add(&FakeCameraStats::resend_requests);
  const auto pin = ring_.find(block_id);
  const std::uint32_t resent = pin && !pin->withheld ? resend_train_.send(*pin, first, last) : 0;
  counters_.add(&FakeCameraStats::resent_packets, resent);
  if (resent > 0) return;
  counters_.add(&FakeCameraStats::resend_misses);
  resend_train_.send_unavailable(block_id, first);
}

std::int64_t StreamSession::due_ns(std::uint16_t block_id, std::int64_t now_ns) noexcept {
  const auto pin = ring_.find(block_id);
  return pin ? start_ns_.load(std::memory_order_relaxed) + pin->due_ns : now_ns;
}

std::uint64_t StreamSession::camera_time_ns(std::int64_t now_ns) const noexcept {
  const std::int64_t start_ns = start_ns_.load(std::memory_order_relaxed);
  return first_timestamp_ns_ + (start_ns == 0 ? 0 : static_cast<std::uint64_t>(now_ns - start_ns));
}

}  // namespace bolo::fakecam
