// Assembles frames from GVSP packets: detects complete and lost frames, and packets to request again.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/genicam/camera_frame.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::genicam::gvsp {

// --- GVSP, the stream protocol of GigE Vision (2.0, chapters 22 to 25): validates and parses a datagram.

inline constexpr std::size_t kNetworkBytes = 20 + 8;  // IP and UDP headers, included in a packet size
inline constexpr std::size_t kHeaderBytes = 8;
inline constexpr std::size_t kExtendedHeaderBytes = 20;
inline constexpr std::uint32_t kShortPacketId = 0x00ffffff;  // packet id mask without extended ids

enum class Content : std::uint8_t { kLeader = 1, kTrailer = 2, kPayload = 3 };

struct Packet {
  Content content = Content::kPayload;
  bool extended = false;        // 64-bit block and 32-bit packet ids instead of 16 and 24 bits
  bool refused = false;         // the camera cannot resend this packet; no body
  std::uint64_t frame_id = 0;   // GigE Vision: block id
  std::uint32_t packet_id = 0;  // within the frame
  std::span<const std::byte> body{};
};

// Nothing for an unknown content type or a truncated header. Thread: any.
std::optional<Packet> parse(std::span<const std::byte> datagram) noexcept;

struct Leader {
  std::uint64_t ticks = 0;  // camera clock
  bool mono16 = false;      // an image of this format; otherwise the members below are 0
  int width = 0;
  int height = 0;
  int x_padding = 0;
};

// Parses a leader's body; nothing when it is too short for its type. Thread: any.
std::optional<Leader> parse_leader(std::span<const std::byte> body) noexcept;

// Camera time in ns, 0 to below 2^62: differences cannot overflow. ticks_per_s: 1 to kMostTicksPerSecond. Thread: any.
inline constexpr std::uint64_t kMostTicksPerSecond = 18'000'000'000;
std::int64_t to_ns(std::uint64_t ticks, std::uint64_t ticks_per_s) noexcept;

struct ResendRequest {
  std::uint64_t frame_id = 0;
  std::uint32_t first = 0;
  std::uint32_t last = 0;
  bool extended = false;
};

// Receives the assembled frames and the resend requests. Thread: acquire.
class FrameOutput {
 public:
  virtual void take_frame(const CameraFrame& frame) noexcept = 0;
  virtual void request_resend(const ResendRequest& request) noexcept = 0;

 protected:
  ~FrameOutput() = default;
};

struct StreamPlan {
  std::size_t payload_bytes = 0;  // per frame, as stated by the camera
  std::size_t packet_bytes = 0;   // with IP and UDP headers; must exceed all headers
  std::size_t frames = 48;        // maximum number in flight
  std::int64_t period_ns = 0;
  std::uint64_t ticks_per_s = 0;  // of the camera's clock; 0: no clock, the arrival time is used
  bool resend = false;
  std::int64_t packet_timeout_ns = 0;  // until a packet is requested again
  // An incomplete frame without a packet for this long no longer delays later ones; without resends it never does.
  std::int64_t retention_ns = 0;
};

// Datagrams may be forged. So every value is checked against the limits of an agreed frame before it is used as an
// index, memory is fixed by the plan, and a frame takes effect only when it or a later one is complete: a single packet
// with an invented id neither creates nor loses a frame. An id that the stream cannot have reached yet only gets a free
// place or that of another such id, and counts when its frame is complete. No allocation after construction. Thread:
// acquire, except construction.
class Assembler {
 public:
  // Counts packets in `status`. Both references outlive this.
  Assembler(const StreamPlan& plan, FrameOutput& output, pipeline::SourceStatus& status);

  // now_ns: CLOCK_MONOTONIC when the datagram was read from the socket; never decreases.
  void take(std::span<const std::byte> datagram, std::int64_t now_ns) noexcept;
  // Processes timeouts; call after each batch of datagrams and every packet_timeout_ns while busy().
  void expire(std::int64_t now_ns) noexcept;
  // True while frames are in flight.
  bool busy() const noexcept;
  // Expected remaining time of the newest frame's packets, from previous frames; <= 0: all received, or late.
  std::int64_t rest_ns(std::int64_t now_ns) const noexcept {
    return latest_ != nullptr && latest_->open && !latest_->whole ? latest_->first_ns + span_ns_ - now_ns : 0;
  }

 private:
  struct PacketState {
    std::int64_t due_ns = 0;  // time of the (next) request; 0: not missing yet
    std::uint32_t bytes = 0;
    bool received = false;
    bool requested = false;
  };
  struct Frame {
    bool open = false;
    bool whole = false;
    bool extended = false;
    bool too_early = false;  // id out of reach when the frame began
    bool no_resend = false;  // not supported, or request limit reached
    std::uint64_t id = 0;
    std::uint32_t packets = 0;  // expected; the trailer may lower it
    bool has_trailer = false;
    std::uint32_t received = 0;
    std::uint32_t prefix = 0;  // all packets before this one are received
    std::uint32_t asked = 0;
    std::uint64_t emitted_before = 0;  // frames emitted when it began
    std::int64_t first_ns = 0;
    std::int64_t last_ns = 0;
    Leader leader;
    std::vector<PacketState> states;
    std::vector<std::byte> data;
  };
  struct Layout {
    std::size_t block_bytes = 0;  // per payload packet
    std::uint32_t packets = 0;    // per frame, with leader and trailer
  };

  const Layout& layout(bool extended) const noexcept { return layouts_[extended ? 1 : 0]; }
  bool possible(const Packet& packet) const noexcept;
  Frame* find(const Packet& packet, std::int64_t now_ns) noexcept;
  Frame* place_for(const Packet& packet, std::int64_t now_ns) noexcept;
  void begin(Frame& frame, const Packet& packet, std::int64_t now_ns) noexcept;
  Frame* choose_place(bool likely, std::int64_t now_ns) noexcept;
  bool store(Frame& frame, const Packet& packet) noexcept;
  void request_missing(Frame& frame, std::uint32_t last, std::int64_t now_ns) noexcept;
  bool request(Frame& frame, std::uint32_t first, std::uint32_t last, std::int64_t now_ns) noexcept;

  std::int64_t steps(std::uint64_t from, std::uint64_t to, bool extended) const noexcept;
  bool within_reach(std::uint64_t id, bool extended, std::int64_t now_ns) const noexcept;
  bool within_reach(const Frame& frame, std::int64_t now_ns) const noexcept {
    return within_reach(frame.id, frame.extended, now_ns);
  }
  bool precedes(const Frame& frame, const Frame& whole, std::int64_t now_ns) const noexcept;
  void deliver(std::int64_t now_ns) noexcept;
  Frame* next_whole(std::int64_t now_ns) noexcept;
  bool blocked(const Frame& whole, std::int64_t now_ns) const noexcept;
  void emit(Frame& frame, std::int64_t now_ns) noexcept;
  std::span<const std::byte> contents(const Frame& frame) const noexcept;
  void give_up(Frame& frame) noexcept;
  void lose(Frame& frame) noexcept;

  const StreamPlan plan_;
  FrameOutput& output_;
  pipeline::SourceStatus& status_;
  std::array<Layout, 2> layouts_;    // short ids, extended ids
  const std::uint64_t frames_held_;  // maximum number delayed by an incomplete frame
  const std::int64_t patience_ns_;   // with an incomplete frame
  std::vector<Frame> frames_;
  Frame* latest_ = nullptr;   // frame of the last packet
  std::int64_t span_ns_ = 0;  // from a frame's first packet to its last
  bool started_ = false;      // a frame has been complete
  bool extended_ = false;     // it had extended ids
  std::uint64_t newest_ = 0;
  std::int64_t newest_ns_ = 0;
  std::uint64_t emitted_ = 0;
};

}  // namespace bolo::genicam::gvsp
