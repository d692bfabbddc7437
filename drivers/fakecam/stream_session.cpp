#include "drivers/fakecam/stream_session.hpp"

#include <pthread.h>
#include <sys/prctl.h>

#include <algorithm>
#include <ctime>

#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::size_t kAheadFrames = 16;
constexpr std::int64_t kLateNs = 1'000'000;
constexpr std::int64_t kStopCheckNs = 20'000'000;

double counts_per_kelvin(IrFormat format) {
  switch (format) {
    case IrFormat::kTemperatureLinear10mK:
      return 100.0;
    case IrFormat::kTemperatureLinear100mK:
      return 10.0;
    case IrFormat::kRadiometric:
      break;
  }
  return 1.0;
}

PacketRoute without_gaps(PacketRoute route) {
  route.burst_gap_ns = 0;
  route.packet_delay_ns = 0;
  return route;
}

}  // namespace

StreamSession::StreamSession(const StreamPlan& plan, FrameProvider& provider, Counters& counters,
                             const StreamFaults& faults)
    : plan_(plan),
      provider_(provider),
      counters_(counters),
      faults_(faults),
      timeline_(provider.frame_ids(), provider.times_s(), provider.format().frame_period_s, plan.rate_hz),
      converter_(provider.format(), plan.ir_format, plan.region),
      ring_(kAheadFrames, plan.keep_frames, Geometry{plan.region.width, plan.region.height}.pixels()),
      train_(plan.route, counters, PacketFaults(faults.tallies, faults.period_ns, plan.fault_clock_ns, false)),
      resend_train_(without_gaps(plan.route), counters,
                    PacketFaults(faults.tallies, faults.period_ns, plan.fault_clock_ns, true)),
      first_timestamp_ns_(timeline_.at(0).timestamp_ns),
      loader_([this] { load_frames(); }),
      sender_([this] { send_frames(); }) {
  Counters::add(counters_.streams_started);
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
  const auto& format = provider_.format();
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
  counters_.streaming.store(true, std::memory_order_relaxed);
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
    if (!frame->withheld) {
      note_lateness(due_ns);
      train_.send(*frame);
      Counters::add(counters_.frames_sent);
    }
    counters_.pass(frame->block.timestamp_ns);
    ring_.end_send();
  }
  if (!stop_requested_.load(std::memory_order_relaxed)) Counters::add(counters_.streams_finished);
  counters_.streaming.store(false, std::memory_order_relaxed);
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

void StreamSession::note_lateness(std::int64_t due_ns) noexcept {
  const std::int64_t lateness_ns = monotonic_ns() - due_ns;
  if (lateness_ns > kLateNs) Counters::add(counters_.late_frames);
  Counters::raise(counters_.worst_lateness_ns, static_cast<std::uint64_t>(std::max<std::int64_t>(lateness_ns, 0)));
}

void StreamSession::resend(std::uint16_t block_id, std::uint32_t first, std::uint32_t last) noexcept {
  Counters::add(counters_.resend_requests);
  const auto pin = ring_.find(block_id);
  const bool there = pin.frame() != nullptr && !pin.frame()->withheld;
  const std::uint32_t resent = there ? resend_train_.send(*pin.frame(), first, last) : 0;
  Counters::add(counters_.resent_packets, resent);
  if (resent > 0) return;
  Counters::add(counters_.resend_misses);
  resend_train_.send_unavailable(block_id, first);
}

std::int64_t StreamSession::due_ns(std::uint16_t block_id, std::int64_t now_ns) noexcept {
  const auto pin = ring_.find(block_id);
  return pin.frame() != nullptr ? start_ns_.load(std::memory_order_relaxed) + pin.frame()->due_ns : now_ns;
}

std::uint64_t StreamSession::camera_time_ns(std::int64_t now_ns) const noexcept {
  const std::int64_t start_ns = start_ns_.load(std::memory_order_relaxed);
  return first_timestamp_ns_ + (start_ns == 0 ? 0 : static_cast<std::uint64_t>(now_ns - start_ns));
}

Status StreamSession::result() const { return result_; }

}  // namespace bolo::fakecam
