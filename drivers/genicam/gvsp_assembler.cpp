#include "drivers/genicam/gvsp_assembler.hpp"

#include <algorithm>
#include <cstring>

#include "src/core/byte_order.hpp"

namespace bolo::genicam::gvsp {
namespace {

using Bytes = std::span<const std::byte>;

constexpr std::uint32_t kExtendedIds = 0x80000000;
constexpr std::uint32_t kContentMask = 0x7f000000;
constexpr unsigned kContentShift = 24;
constexpr std::uint16_t kError = 0x8000;
constexpr std::uint16_t kImage = 0x0001;
constexpr std::uint16_t kPayloadTypeMask = 0x3fff;  // above: chunk flag
constexpr std::uint32_t kMono16 = 0x01100007;
constexpr std::size_t kShortestLeader = 12;
constexpr std::size_t kImageLeader = 36;
constexpr std::uint32_t kLargestSide = 1U << 16U;

// PACKET_UNAVAILABLE, or removed from the camera's memory, alone or with previous ones. Other errors may be transient.
bool is_final(std::uint16_t status) noexcept {
  const auto code = static_cast<unsigned>(status & 0xffU);
  return code == 0x0c || code == 0x11 || code == 0x12;
}

bool known(std::uint32_t content) noexcept {
  return content >= static_cast<std::uint32_t>(Content::kLeader) &&
         content <= static_cast<std::uint32_t>(Content::kPayload);
}

// Aravis's values, to behave towards cameras like Aravis.
constexpr std::int64_t kFirstTimeoutNs = 1'000'000;  // until an overtaken packet is requested
constexpr std::uint32_t kMostAskedPart = 4;          // at most 1/4 of a frame's packets is requested again
constexpr std::int64_t kSpanGrows = 8;               // span_ns_ grows by at most 1/8 per frame, plus:
constexpr std::int64_t kSpanStepNs = 20'000;
constexpr std::int64_t kLateFrames = 100;  // late packet: at most this far behind; further back, the counter restarted

// The counter may be ahead by this many frames plus those of the elapsed time, with a margin.
constexpr std::int64_t kAheadFrames = 4;
constexpr std::int64_t kTimeMargin = 2;
constexpr std::int64_t kNearFrames = 64;  // an incomplete frame this far behind a complete one has another counter
constexpr std::uint64_t kOthers = 4;  // after this many more complete frames, an incomplete one is not counted as lost

}  // namespace

std::optional<Packet> parse(Bytes datagram) noexcept {
  if (datagram.size() < kHeaderBytes) return std::nullopt;
  const std::uint16_t status = load_u16(datagram, 0);
  const std::uint32_t infos = load_u32(datagram, 4);
  Packet packet;
  packet.extended = (infos & kExtendedIds) != 0;
  const std::size_t header = packet.extended ? kExtendedHeaderBytes : kHeaderBytes;
  if (datagram.size() < header) return std::nullopt;
  packet.frame_id = packet.extended ? load_u64(datagram, 8) : load_u16(datagram, 2);
  packet.packet_id = packet.extended ? load_u32(datagram, 16) : infos & kShortPacketId;
  if ((status & kError) != 0) {
    packet.refused = true;
    return is_final(status) ? std::optional(packet) : std::nullopt;
  }
  const std::uint32_t content = (infos & kContentMask) >> kContentShift;
  if (!known(content)) return std::nullopt;
  packet.content = static_cast<Content>(content);
  packet.body = datagram.subspan(header);
  return packet;
}

std::optional<Leader> parse_leader(Bytes body) noexcept {
  if (body.size() < kShortestLeader) return std::nullopt;
  Leader leader;
  leader.ticks = load_u64(body, 4);
  if ((load_u16(body, 2) & kPayloadTypeMask) != kImage) return leader;
  if (body.size() < kImageLeader) return std::nullopt;
  const std::uint32_t width = load_u32(body, 16);
  const std::uint32_t height = load_u32(body, 20);
  if (load_u32(body, 12) != kMono16 || width > kLargestSide || height > kLargestSide) return leader;
  leader.mono16 = true;
  leader.width = static_cast<int>(width);
  leader.height = static_cast<int>(height);
  leader.x_padding = load_u16(body, 32);
  return leader;
}

std::int64_t to_ns(std::uint64_t ticks, std::uint64_t ticks_per_s) noexcept {
  constexpr std::uint64_t kBelow = std::uint64_t{1} << 62U;
  constexpr std::uint64_t kNs = 1'000'000'000;
  const std::uint64_t ns = ticks / ticks_per_s * kNs + ticks % ticks_per_s * kNs / ticks_per_s;
  return static_cast<std::int64_t>(ns % kBelow);
}

Assembler::Assembler(const StreamPlan& plan, FrameOutput& output, pipeline::SourceStatus& status)
    : plan_(plan),
      output_(output),
      status_(status),
      frames_held_(
          plan.resend ? static_cast<std::uint64_t>(plan.retention_ns / std::max<std::int64_t>(plan.period_ns, 1)) : 0),
      patience_ns_(std::max(plan.retention_ns, static_cast<std::int64_t>(2 * kOthers + frames_held_) * plan.period_ns)),
      frames_(plan.frames) {
  for (const bool extended : {false, true}) {
    Layout& layout = layouts_[extended ? 1 : 0];
    const std::size_t overhead = kNetworkBytes + (extended ? kExtendedHeaderBytes : kHeaderBytes);
    layout.block_bytes = plan.packet_bytes > overhead ? plan.packet_bytes - overhead : 1;
    layout.packets = static_cast<std::uint32_t>((plan.payload_bytes + layout.block_bytes - 1) / layout.block_bytes + 2);
  }
  for (Frame& frame : frames_) {
    frame.states.resize(layouts_[1].packets);  // extended headers are longer: more packets
    frame.data.resize(plan.payload_bytes);
  }
}

void Assembler::take(std::span<const std::byte> datagram, std::int64_t now_ns) noexcept {
  status_.received_packets.add();
  const std::optional<Packet> packet = parse(datagram);
  Frame* frame = packet && possible(*packet) ? find(*packet, now_ns) : nullptr;
  if (frame == nullptr) return;
  if (packet->refused) {
    frame->no_resend = true;
    return;
  }
  PacketState& state = frame->states[packet->packet_id];
  // A duplicate replaces the first packet, because a forged one usually arrives early.
  if (!store(*frame, *packet)) return;
  frame->last_ns = now_ns;
  if (state.received) return;
  state.received = true;
  ++frame->received;
  if (state.requested) status_.resent_packets.add();
  while (frame->prefix < frame->packets && frame->states[frame->prefix].received) ++frame->prefix;
  if (frame->prefix == frame->packets && frame->has_trailer) {
    frame->whole = true;
    if (frame->asked == 0) {  // a late frame must not delay the next
      span_ns_ = std::min(now_ns - frame->first_ns, span_ns_ + span_ns_ / kSpanGrows + kSpanStepNs);
    }
    deliver(now_ns);
  } else {
    request_missing(*frame, packet->packet_id, now_ns);
  }
}

// True when a frame of the agreed size can contain this packet.
bool Assembler::possible(const Packet& packet) const noexcept {
  const std::uint32_t id = packet.packet_id;
  const std::uint32_t last = layout(packet.extended).packets - 1;
  if (packet.refused) return id <= last;
  switch (packet.content) {
    case Content::kLeader:
      return id == 0;
    case Content::kPayload:
      return id >= 1 && id < last;
    case Content::kTrailer:
      return id >= 1 && id <= last;
  }
  return false;
}

Assembler::Frame* Assembler::find(const Packet& packet, std::int64_t now_ns) noexcept {
  const auto is_it = [&packet](const Frame& frame) {
    return frame.open && frame.id == packet.frame_id && frame.extended == packet.extended;
  };
  Frame* frame = latest_ != nullptr && is_it(*latest_) ? latest_ : nullptr;
  if (frame == nullptr) {
    const auto at = std::ranges::find_if(frames_, is_it);
    frame = at != frames_.end() ? &*at : packet.refused ? nullptr : place_for(packet, now_ns);
  }
  if (frame == nullptr) return nullptr;
  if (frame->too_early && !frame->whole && within_reach(*frame, now_ns)) begin(*frame, packet, now_ns);
  return latest_ = frame;
}

// Begins a frame; null when its id is in the past or there is no room.
Assembler::Frame* Assembler::place_for(const Packet& packet, std::int64_t now_ns) noexcept {
  if (started_ && packet.extended == extended_) {
    const std::int64_t ahead = steps(newest_, packet.frame_id, extended_);
    if (ahead <= 0 && ahead > -kLateFrames) return nullptr;
  }
  Frame* place = choose_place(within_reach(packet.frame_id, packet.extended, now_ns), now_ns);
  if (place == nullptr) return nullptr;
  if (place->open) give_up(*place);
  begin(*place, packet, now_ns);
  return place;
}

void Assembler::begin(Frame& frame, const Packet& packet, std::int64_t now_ns) noexcept {
  frame.open = true;
  frame.whole = frame.has_trailer = frame.no_resend = false;
  frame.extended = packet.extended;
  frame.id = packet.frame_id;
  frame.too_early = !within_reach(frame, now_ns);
  frame.packets = layout(packet.extended).packets;
  frame.received = frame.prefix = frame.asked = 0;
  frame.emitted_before = emitted_;
  frame.first_ns = frame.last_ns = now_ns;
  std::ranges::fill(frame.states, PacketState{});
}

// A free place; else the least recently active frame with an unlikely id; else, if `likely`, the least recent of all.
Assembler::Frame* Assembler::choose_place(bool likely, std::int64_t now_ns) noexcept {
  Frame* quietest = nullptr;
  Frame* unlikely = nullptr;
  for (Frame& frame : frames_) {
    if (!frame.open) return &frame;
    if (frame.whole) continue;
    if (quietest == nullptr || frame.last_ns < quietest->last_ns) quietest = &frame;
    if (within_reach(frame, now_ns)) continue;
    if (unlikely == nullptr || frame.last_ns < unlikely->last_ns) unlikely = &frame;
  }
  return unlikely != nullptr ? unlikely : likely ? quietest : nullptr;
}

// Stores the packet's content. False when it does not fit.
bool Assembler::store(Frame& frame, const Packet& packet) noexcept {
  const std::uint32_t id = packet.packet_id;
  if (packet.content == Content::kLeader) {
    const std::optional<Leader> leader = parse_leader(packet.body);
    if (!leader) return false;
    frame.leader = *leader;
    return true;
  }
  if (id >= frame.packets) return false;  // behind the trailer
  if (packet.content == Content::kTrailer) {
    if (frame.has_trailer) return id + 1 == frame.packets;
    if (frame.prefix > id) return false;
    frame.has_trailer = true;
    frame.packets = id + 1;  // a camera may send less than the maximum
    return true;
  }
  const Layout& expected = layout(frame.extended);
  if (packet.body.size() > expected.block_bytes) return false;
  const std::size_t from = (id - 1) * expected.block_bytes;
  const std::size_t bytes = std::min(packet.body.size(), frame.data.size() - from);  // the last packet may be padded
  if (bytes > 0) std::memcpy(frame.data.data() + from, packet.body.data(), bytes);
  frame.states[id].bytes = static_cast<std::uint32_t>(bytes);
  return true;
}

// Received bytes of a complete frame up to the first gap.
std::span<const std::byte> Assembler::contents(const Frame& frame) const noexcept {
  std::size_t bytes = 0;
  for (std::uint32_t id = 1; id + 1 < frame.packets; ++id) {
    bytes += frame.states[id].bytes;
    if (frame.states[id].bytes != layout(frame.extended).block_bytes) break;
  }
  return std::span(frame.data).first(bytes);
}

// --- missing packets ---

// Requests missing packets up to `last` whose timeout has expired; the first call for a packet only starts its timeout.
void Assembler::request_missing(Frame& frame, std::uint32_t last, std::int64_t now_ns) noexcept {
  if (!plan_.resend || frame.no_resend || frame.packets < kMostAskedPart) return;
  std::uint32_t first = 0;  // of a run to request
  std::uint32_t run = 0;
  for (std::uint32_t id = frame.prefix; id <= last && id < frame.packets; ++id) {
    PacketState& state = frame.states[id];
    if (!state.received && state.due_ns == 0) state.due_ns = now_ns + kFirstTimeoutNs;
    if (!state.received && now_ns > state.due_ns) {
      if (run++ == 0) first = id;
      continue;
    }
    if (run > 0 && !request(frame, first, first + run - 1, now_ns)) return;
    run = 0;
  }
  if (run > 0) request(frame, first, first + run - 1, now_ns);
}

// False when the limit of requests per frame is exceeded.
bool Assembler::request(Frame& frame, std::uint32_t first, std::uint32_t last, std::int64_t now_ns) noexcept {
  const std::uint32_t count = last - first + 1;
  frame.asked += count;
  if (frame.asked > frame.packets / kMostAskedPart) {
    frame.no_resend = true;
    return false;
  }
  for (std::uint32_t id = first; id <= last; ++id) {
    frame.states[id].due_ns = now_ns + plan_.packet_timeout_ns;
    frame.states[id].requested = true;
  }
  output_.request_resend({frame.id, first, last, frame.extended});
  return true;
}

void Assembler::expire(std::int64_t now_ns) noexcept {
  for (Frame& frame : frames_) {
    if (!frame.open || frame.whole || now_ns - frame.last_ns < plan_.packet_timeout_ns) continue;
    request_missing(frame, frame.packets - 1, now_ns);
  }
  if (plan_.resend) deliver(now_ns);
  for (;;) {
    Frame* oldest = nullptr;
    for (Frame& frame : frames_) {
      if (!frame.open || frame.whole || now_ns - frame.last_ns < patience_ns_) continue;
      if (oldest == nullptr || frame.first_ns < oldest->first_ns) oldest = &frame;
    }
    if (oldest == nullptr) return;
    give_up(*oldest);
  }
}

bool Assembler::busy() const noexcept {
  return std::ranges::any_of(frames_, [](const Frame& frame) { return frame.open; });
}

// --- frame order ---

std::int64_t Assembler::steps(std::uint64_t from, std::uint64_t to, bool extended) const noexcept {
  if (extended) return static_cast<std::int64_t>(to - from);
  return static_cast<std::int16_t>(static_cast<std::uint16_t>(to - from));
}

// True when the stream can have reached this id by now.
bool Assembler::within_reach(std::uint64_t id, bool extended, std::int64_t now_ns) const noexcept {
  if (!started_) return true;
  if (extended != extended_) return false;
  const std::int64_t ahead = steps(newest_, id, extended);
  const std::int64_t passed = (now_ns - newest_ns_) / std::max<std::int64_t>(plan_.period_ns, 1);
  return ahead > 0 && ahead <= kAheadFrames + kTimeMargin * passed;
}

// True when the frame was sent before the complete one.
bool Assembler::precedes(const Frame& frame, const Frame& whole, std::int64_t now_ns) const noexcept {
  if (&frame == &whole || !frame.open || frame.extended != whole.extended) return false;
  const std::int64_t behind = steps(frame.id, whole.id, frame.extended);
  if (started_ && within_reach(frame, now_ns)) {
    // A restarted counter comes after everything of the old one.
    return !within_reach(whole, now_ns) || behind > 0;
  }
  return behind > 0 && behind < kNearFrames;
}

void Assembler::deliver(std::int64_t now_ns) noexcept {
  while (Frame* frame = next_whole(now_ns)) {
    if (blocked(*frame, now_ns)) return;
    emit(*frame, now_ns);
  }
}

Assembler::Frame* Assembler::next_whole(std::int64_t now_ns) noexcept {
  Frame* next = nullptr;
  for (Frame& frame : frames_) {
    if (frame.open && frame.whole && (next == nullptr || precedes(frame, *next, now_ns))) next = &frame;
  }
  return next;
}

// True while an earlier frame may still be completed.
bool Assembler::blocked(const Frame& whole, std::int64_t now_ns) const noexcept {
  return plan_.resend && std::ranges::any_of(frames_, [&](const Frame& frame) {
           return precedes(frame, whole, now_ns) && !frame.whole && now_ns - frame.last_ns < plan_.retention_ns;
         });
}

void Assembler::emit(Frame& whole, std::int64_t now_ns) noexcept {
  for (;;) {  // lose earlier incomplete frames, oldest first
    Frame* before = nullptr;
    for (Frame& frame : frames_) {
      if (!precedes(frame, whole, now_ns) || frame.whole) continue;
      if (before == nullptr || precedes(frame, *before, now_ns)) before = &frame;
    }
    if (before == nullptr) break;
    lose(*before);
  }
  ++emitted_;
  started_ = true;
  extended_ = whole.extended;
  newest_ = whole.id;
  newest_ns_ = now_ns;
  whole.open = false;
  const Leader& leader = whole.leader;
  output_.take_frame({.end = FrameEnd::kWhole,
                      .id = whole.id,
                      .camera_ns = plan_.ticks_per_s > 0 ? to_ns(leader.ticks, plan_.ticks_per_s) : whole.first_ns,
                      .receive_ns = whole.first_ns,
                      .mono16 = leader.mono16,
                      .width = leader.width,
                      .height = leader.height,
                      .x_padding = leader.x_padding,
                      .pixels = contents(whole)});
}

// Stops waiting for a frame. If other frames were completed meanwhile, its id is either forged or found missing later
// by the id counter; otherwise it is lost.
void Assembler::give_up(Frame& frame) noexcept {
  if (emitted_ - frame.emitted_before < kOthers + frames_held_ && within_reach(frame, frame.last_ns))
    return lose(frame);
  frame.open = false;
}

void Assembler::lose(Frame& frame) noexcept {
  frame.open = false;
  status_.missing_packets.add(frame.packets - std::min(frame.received, frame.packets));
  output_.take_frame({.end = FrameEnd::kIncomplete, .id = frame.id});
}

}  // namespace bolo::genicam::gvsp
