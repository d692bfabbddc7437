// GVSP datagrams for tests: valid ones, and ones that no camera sends.
#pragma once

#include "drivers/genicam/gvsp_assembler.hpp"
#include "src/core/splitmix.hpp"
#include "tests/test.hpp"

namespace bolo::genicam::gvsp::test {

using Datagram = std::vector<std::byte>;

inline void add(Datagram& to, std::uint64_t value, unsigned bytes) {
  while (bytes-- > 0) to.push_back(static_cast<std::byte>(value >> 8U * bytes & 0xffU));
}

struct Header {
  std::uint64_t frame = 1;
  unsigned content = 3;
  std::uint32_t packet = 1;
  bool extended = false;
  unsigned status = 0;
};

inline Datagram datagram(const Header& h, std::size_t body_bytes = 0, unsigned fill = 0) {
  Datagram out;
  add(out, h.status, 2);
  if (h.extended) {
    add(out, 0, 2);
    add(out, 0x80U | h.content, 1);
    add(out, 0, 3);
    add(out, h.frame, 8);
    add(out, h.packet, 4);
  } else {
    add(out, h.frame, 2);
    add(out, h.content, 1);
    add(out, h.packet, 3);
  }
  for (std::size_t i = 0; i < body_bytes; ++i) out.push_back(static_cast<std::byte>(fill));
  return out;
}

inline Datagram leader(std::uint64_t frame, bool extended, std::uint64_t ticks, int width, int height) {
  Datagram out = datagram({frame, 1, 0, extended});
  add(out, 0x0001, 4);
  add(out, ticks, 8);
  add(out, 0x01100007, 4);
  add(out, static_cast<std::uint64_t>(width), 4);
  add(out, static_cast<std::uint64_t>(height), 4);
  add(out, 0, 8);
  add(out, 0, 4);
  return out;
}

// The n-th of a hostile mixture with random ids; some of its kinds crashed Aravis 0.8.26.
inline Datagram forged(std::uint64_t n, std::uint64_t seed) {
  const std::uint64_t random = splitmix::key(seed, n);
  const std::uint64_t frame = random >> 8U & 0xffffU;
  const auto small = static_cast<std::uint32_t>(random >> 24U & 0x7fU);
  const bool extended = (random >> 32U & 1U) != 0;
  const auto length = static_cast<std::size_t>(random >> 40U & 0x3fU);
  switch (random % 10) {
    case 0:
      return datagram({frame, 2, 0xfffffffe, true});
    case 1:
      return datagram({frame, 2, 0x7fffffff, true});
    case 2:
      return datagram({frame, 2, 0xffff});
    case 3:
      return datagram({frame, 3, 0xfff0}, length);
    case 4:
      return datagram({frame, 5, small, extended}, length);
    case 5:
      return datagram({frame, 3, small, extended}, length);
    case 6:
      return leader(frame, extended, random, 640, 120);
    case 7:
      return datagram({frame, 2, small, extended}, 8);
    case 8:
      return datagram({frame, 3, small, extended, 0x800c});
    default: {
      Datagram noise = datagram({random, static_cast<unsigned>(random >> 48U & 0xfU), small, extended}, 64);
      for (std::size_t i = 0; i < noise.size(); ++i) noise[i] ^= static_cast<std::byte>(splitmix::key(random, i));
      noise.resize(length);
      return noise;
    }
  }
}

}  // namespace bolo::genicam::gvsp::test
