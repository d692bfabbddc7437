// How a camera's frames lie in the bytes of a bulk endpoint. Experimental: no camera whose protocol is known was at
// hand.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"

namespace bolo::usb {

// What ends a frame. A short packet is one with fewer bytes than the endpoint's packets hold, or none.
enum class Framing {
  kShortPacket,  // each frame ends with a short packet, and only there
  kPacked,       // frames follow one another without a break; a short packet may come between two, or cuts one off
};

// A number in the header that grows by one a frame.
struct CounterField {
  std::size_t offset = 0;  // bytes from the frame's first
  std::size_t bytes = 4;   // 1, 2, 4 or 8
  bool big_endian = false;
};

// header, pixels (16 bits each, row by row), trailer
struct FrameLayout {
  Geometry geometry;
  std::size_t header_bytes = 0;
  std::vector<std::byte> magic{};  // what each header begins with; empty: unknown
  std::optional<CounterField> counter{};
  bool big_endian_pixels = false;
  std::size_t trailer_bytes = 0;
  Framing framing = Framing::kShortPacket;

  std::size_t frame_bytes() const { return header_bytes + geometry.pixels() * 2 + trailer_bytes; }
};

// kBadInput: no such frame can be. Thread: any.
Status check(const FrameLayout& layout);

}  // namespace bolo::usb
