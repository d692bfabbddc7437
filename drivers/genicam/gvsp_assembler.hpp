// Assembles frames from GVSP packets: finds whole and lost frames, and the packets to request again.
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

// --- GVSP, the stream protocol of GigE Vision (2.0, chapters 22 to 25): one datagram, checked and taken apart.

inline constexpr std::size_t kNetworkBytes = 20 + 8;  // IP and UDP headers, which a packet size counts
inline constexpr std::size_t kHeaderBytes = 8;
inline constexpr std::size_t kExtendedHeaderBytes = 20;
inline constexpr std::uint32_t kShortPacketId = 0x00ffffff;  // a packet's id where ids are not extended

enum class Content : std::uint8_t { kLeader = 1, kTrailer = 2, kPayload = 3 };

struct Packet {
  Content content = Content::kPayload;
  bool extended = false;        // ids of 64 and 32 bits, not of 16 and 24
  bool refused = false;         // the camera cannot send this packet again; there is no body
  std::uint64_t frame_id = 0;   // GigE Vision: block id
  std::uint32_t packet_id = 0;  // within the frame
  std::span<const std::byte> body{};
};

// Nothing for what is none of the three contents, or too short for its header. Thread: any.
std::optional<Packet> parse(std::span<const std::byte> datagram) noexcept;

struct Leader {
  std::uint64_t ticks = 0;  // the camera's clock
  bool mono16 = false;      // an image of this format; of anything else the rest is 0
  int width = 0;
  int height = 0;
  int x_padding = 0;
};

// From a leader's body; nothing when it is too short for its type. Thread: any.
std::optional<Leader> parse_leader(std::span<const std::byte> body) noexcept;

// The camera's time in ns, from 0 to below 2^62, so that differences cannot overflow. ticks_per_s: 1 to
// kMostTicksPerSecond. Thread: any.
inline constexpr std::uint64_t kMostTicksPerSecond = 18'000'000'000;
std::int64_t to_ns(std::uint64_t ticks, std::uint64_t ticks_per_s) noexcept;

struct ResendRequest {
  std::uint64_t frame_id = 0;
  std::uint32_t first = 0;
  std::uint32_t last = 0;
  bool extended = false;
};

// Receives the assembled frames and the requests for resends. Thread: acquire.
class FrameOutput {
 public:
  virtual void take_frame(const CameraFrame& frame) noexcept = 0;
  virtual void request_resend(const ResendRequest& request) noexcept = 0;

 protected:
  ~FrameOutput() = default;
};

struct StreamPlan {
  std::size_t payload_bytes = 0;  // of a frame, as stated by the camera
  std::size_t packet_bytes = 0;   // with IP and UDP headers, more than both and a header
  std::size_t frames = 48;        // that may be under way at once
  std::int64_t period_ns = 0;
  std::uint64_t ticks_per_s = 0;  // of the camera's clock; 0: it has none, the arrival stands in for it
  bool resend = false;
  std::int64_t packet_timeout_ns = 0;  // until a packet is asked for once more
  // Without a packet for this long an incomplete frame holds up the later ones no more; without resends none ever does.
  std::int64_t retention_ns = 0;
};

// A datagram can come from anyone. So none of its values is an index before it was compared with what a frame of the
// agreed size can have, memory is that of the plan, and a frame is accepted only when it is whole, or when a later
// frame is: a lone packet with an invented number makes no frame, and loses none. A number that the stream cannot have
// reached by now takes a place only while one is free, or from another such; it counts when its frame is whole. Thread:
// acquire, but for construction. Nothing allocates after construction.
class Assembler {
 public:
  // Counts packets in `status`. Both outlive this.
  Assembler(const StreamPlan& plan, FrameOutput& output, pipeline::SourceStatus& status);

  // now_ns: CLOCK_MONOTONIC, when the datagram was taken from the socket; never falls.
  void take(std::span<const std::byte> datagram, std::int64_t now_ns) noexcept;
  // Time has passed; call it after each batch of datagrams and every packet_timeout_ns while busy().
  void expire(std::int64_t now_ns) noexcept;
  // Frames are under way.
  bool busy() const noexcept;
  // Expected remaining time of the newest frame's packets, by the frames before; not above 0: they
  // are all there, or late.
  std::int64_t rest_ns(std::int64_t now_ns) const noexcept {
    return latest_ != nullptr && latest_->open && !latest_->whole ? latest_->first_ns + span_ns_ - now_ns : 0;
  }

 private:
  struct PacketState {
    std::int64_t due_ns = 0;  // when it is requested (again); 0: not missing yet
    std::uint32_t bytes = 0;
    bool received = false;
    bool requested = false;
  };
  struct Frame {
    bool open = false;
    bool whole = false;
    bool extended = false;
    bool too_early = false;  // for what the stream had come to when it began
    bool no_resend = false;  // the camera cannot, or too much was asked for
    std::uint64_t id = 0;
    std::uint32_t packets = 0;  // expected; fewer by the trailer
    bool has_trailer = false;
    std::uint32_t received = 0;
    std::uint32_t prefix = 0;  // all packets before this one have come
    std::uint32_t asked = 0;
    std::uint64_t emitted_before = 0;  // frames that were handed on when it began
    std::int64_t first_ns = 0;
    std::int64_t last_ns = 0;
    Leader leader;
    std::vector<PacketState> states;
    std::vector<std::byte> data;
  };
  struct Layout {
    std::size_t block_bytes = 0;  // of a payload packet
    std::uint32_t packets = 0;    // of a frame, with leader and trailer
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
  const std::uint64_t frames_held_;  // that an incomplete frame can hold up
  const std::int64_t patience_ns_;   // with an incomplete frame
  std::vector<Frame> frames_;
  Frame* latest_ = nullptr;   // that a packet came for
  std::int64_t span_ns_ = 0;  // from a frame's first packet to its last
  bool started_ = false;      // a frame was whole
  bool extended_ = false;     // its ids were
  std::uint64_t newest_ = 0;
  std::int64_t newest_ns_ = 0;
  std::uint64_t emitted_ = 0;
};

}  // namespace bolo::genicam::gvsp
