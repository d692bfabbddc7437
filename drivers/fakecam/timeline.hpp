// The order, ids and time stamps in which the frames of a capture are sent.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace bolo::fakecam {

struct Moment {
  std::size_t index = 0;  // of the frame in the capture
  std::uint64_t frame_id = 0;
  std::uint64_t timestamp_ns = 0;
};

// GigE Vision 1.2 has 16-bit block ids and never uses 0: the same step of the capture's counter is the same step on the
// wire. Thread: any.
constexpr std::uint16_t block_id_of(std::uint64_t frame_id) { return static_cast<std::uint16_t>(frame_id % 65535 + 1); }

// Replays a capture lap after lap as if the camera had never stopped: at the seam the id and the time are one frame
// apart. At the capture's own rate the times are those of the capture; at another rate R they are spaced 1/R a frame,
// lost frames included. Thread: any (immutable).
class Timeline {
 public:
  // Both spans have the same size, at least 1, and rise. rate_hz 0: the capture's own rate.
  Timeline(std::span<const std::uint64_t> frame_ids, std::span<const double> times_s, double period_s, double rate_hz);

  std::size_t frames() const { return ids_.size(); }
  Moment at(std::uint64_t sequence) const;

 private:
  std::vector<std::uint64_t> ids_;
  std::vector<std::int64_t> times_ns_;
  std::uint64_t lap_ids_ = 0;
  std::int64_t lap_ns_ = 0;
};

}  // namespace bolo::fakecam
