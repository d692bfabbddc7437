#include "drivers/fakecam/stats.hpp"

namespace bolo::fakecam {

FakeCameraStats Counters::read() const noexcept {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  FakeCameraStats s;
  s.frames_sent = frames_sent.load(kRelaxed);
  s.packets_sent = packets_sent.load(kRelaxed);
  s.send_errors = send_errors.load(kRelaxed);
  s.late_frames = late_frames.load(kRelaxed);
  s.worst_lateness_ns = worst_lateness_ns.load(kRelaxed);
  s.resend_requests = resend_requests.load(kRelaxed);
  s.resent_packets = resent_packets.load(kRelaxed);
  s.resend_misses = resend_misses.load(kRelaxed);
  s.commands = commands.load(kRelaxed);
  s.bad_commands = bad_commands.load(kRelaxed);
  s.clients = clients.load(kRelaxed);
  s.heartbeat_losses = heartbeat_losses.load(kRelaxed);
  s.streams_started = streams_started.load(kRelaxed);
  s.streams_finished = streams_finished.load(kRelaxed);
  s.nuc_actions = nuc_actions.load(kRelaxed);
  s.first_stream_ns = first_stream_ns.load(kRelaxed);
  {
    const std::lock_guard lock(position_mutex_);
    s.position = position_;
  }
  s.controlled = controlled.load(kRelaxed);
  s.streaming = streaming.load(kRelaxed);
  return s;
}

}  // namespace bolo::fakecam
