// Big-endian fields of GigE Vision packets, written and read byte by byte: no casts, no alignment assumed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace bolo::fakecam {

using Bytes = std::span<std::uint8_t>;
using ConstBytes = std::span<const std::uint8_t>;

// The caller has checked that the field lies inside `bytes`. Thread: any.
constexpr std::uint16_t load_u16(ConstBytes bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] << 8U | bytes[at + 1]);
}

constexpr std::uint32_t load_u32(ConstBytes bytes, std::size_t at) {
  return static_cast<std::uint32_t>(load_u16(bytes, at)) << 16U | load_u16(bytes, at + 2);
}

constexpr void store_u16(Bytes bytes, std::size_t at, std::uint16_t value) {
  bytes[at] = static_cast<std::uint8_t>(value >> 8U);
  bytes[at + 1] = static_cast<std::uint8_t>(value & 0xffU);
}

constexpr void store_u32(Bytes bytes, std::size_t at, std::uint32_t value) {
  store_u16(bytes, at, static_cast<std::uint16_t>(value >> 16U));
  store_u16(bytes, at + 2, static_cast<std::uint16_t>(value & 0xffffU));
}

constexpr void store_u64(Bytes bytes, std::size_t at, std::uint64_t value) {
  store_u32(bytes, at, static_cast<std::uint32_t>(value >> 32U));
  store_u32(bytes, at + 4, static_cast<std::uint32_t>(value & 0xffffffffU));
}

}  // namespace bolo::fakecam
