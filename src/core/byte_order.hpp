// Values in the byte order of a device.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace bolo {

// Thread: any.
constexpr std::uint16_t swap_bytes(std::uint16_t value) noexcept {
  return static_cast<std::uint16_t>(value << 8 | value >> 8);
}

// 16-bit values from bytes in big-endian or little-endian order. The loop becomes vector shuffles. `from` need not be
// aligned. Thread: any.
inline void copy_values(const std::byte* from, bool big_endian, std::uint16_t* to, std::size_t count) noexcept {
  if (big_endian == (std::endian::native == std::endian::big)) {
    std::memcpy(to, from, count * sizeof *to);
    return;
  }
  for (std::size_t i = 0; i < count; ++i) {
    std::uint16_t value = 0;
    std::memcpy(&value, from + 2 * i, sizeof value);
    to[i] = swap_bytes(value);
  }
}

}  // namespace bolo
