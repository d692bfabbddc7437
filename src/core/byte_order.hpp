// Values in the byte order of a device.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace bolo {

// Thread: any.
constexpr std::uint16_t swap_bytes(std::uint16_t value) noexcept {
  return static_cast<std::uint16_t>(value << 8 | value >> 8);
}

// Big-endian words of a datagram, of any alignment. The caller has checked the bounds. Thread: any.
constexpr std::uint16_t load_u16(const auto& bytes, std::size_t at) noexcept {
  return static_cast<std::uint16_t>(static_cast<unsigned>(bytes[at]) << 8U | static_cast<unsigned>(bytes[at + 1]));
}
constexpr std::uint32_t load_u32(const auto& bytes, std::size_t at) noexcept {
  return static_cast<std::uint32_t>(load_u16(bytes, at)) << 16U | load_u16(bytes, at + 2);
}
constexpr std::uint64_t load_u64(const auto& bytes, std::size_t at) noexcept {
  return static_cast<std::uint64_t>(load_u32(bytes, at)) << 32U | load_u32(bytes, at + 4);
}

constexpr void store_u16(std::span<std::uint8_t> bytes, std::size_t at, std::uint32_t value) {
  bytes[at] = static_cast<std::uint8_t>(value >> 8U & 0xffU);
  bytes[at + 1] = static_cast<std::uint8_t>(value & 0xffU);
}
constexpr void store_u32(std::span<std::uint8_t> bytes, std::size_t at, std::uint32_t value) {
  store_u16(bytes, at, value >> 16U);
  store_u16(bytes, at + 2, value & 0xffffU);
}

// 16-bit values from big- or little-endian bytes; becomes vector shuffles. `from` need not be aligned. Thread: any.
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
