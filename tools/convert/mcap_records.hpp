// The words of MCAP: records of an operation code, a length and fields, all little-endian.
// Source: https://mcap.dev/spec (version 0).
#pragma once

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

#include "src/core/printable.hpp"

namespace bolo::tools::mcap {

static_assert(std::endian::native == std::endian::little, "fields are written as the machine has them");

inline constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};
inline constexpr std::size_t kRecordHead = 9;  // code and length

enum class Op : std::uint8_t {
  kHeader = 1,
  kFooter,
  kSchema,
  kChannel,
  kMessage,
  kChunk,
  kMessageIndex,
  kChunkIndex,
  kAttachment,
  kAttachmentIndex,
  kStatistics,
  kMetadata,
  kMetadataIndex,
  kSummaryOffset,
  kDataEnd,
};

// CRC-32, going on from that of what stands before. Thread: any.
inline std::uint32_t crc_of(std::uint32_t before, std::string_view bytes) {
  return static_cast<std::uint32_t>(crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

using Texts = std::map<std::string, std::string>;

// Appends fields.
class Fields {
 public:
  template <typename T>
  requires std::is_arithmetic_v<T> Fields& number(T value) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + sizeof value);
    std::memcpy(bytes_.data() + at, &value, sizeof value);
    return *this;
  }
  Fields& raw(std::string_view bytes) {
    bytes_.append(bytes);
    return *this;
  }
  // Of known length: a string, an array, a map.
  Fields& text(std::string_view bytes) { return number(static_cast<std::uint32_t>(bytes.size())).raw(bytes); }
  Fields& texts(const Texts& map) {
    Fields inside;
    for (const auto& [key, value] : map) inside.text(key).text(value);
    return text(inside.bytes());
  }
  Fields& record(Op op, const Fields& fields) {
    return number(static_cast<std::uint8_t>(op)).number(std::uint64_t{fields.bytes().size()}).raw(fields.bytes());
  }

  const std::string& bytes() const { return bytes_; }
  std::size_t size() const { return bytes_.size(); }
  void clear() { bytes_.clear(); }

 private:
  std::string bytes_;
};

// Takes fields; zeros, and good() is false, from the first one that the bytes do not hold.
class FieldReader {
 public:
  explicit FieldReader(std::string_view bytes) : rest_(bytes) {}

  template <typename T>
  requires std::is_arithmetic_v<T> T number() {
    T value{};
    const std::string_view bytes = raw(sizeof value);
    if (good_) std::memcpy(&value, bytes.data(), sizeof value);
    return value;
  }
  std::string_view raw(std::uint64_t count) {
    good_ = good_ && count <= rest_.size();
    if (!good_) return {};
    const std::string_view bytes = rest_.substr(0, static_cast<std::size_t>(count));
    rest_.remove_prefix(bytes.size());
    return bytes;
  }
  std::string_view text() { return raw(number<std::uint32_t>()); }
  Texts texts() {
    FieldReader inside(text());
    Texts map;
    while (inside.good() && !inside.rest().empty()) {
      const std::string_view key = inside.text();
      map.emplace(key, inside.text());
    }
    good_ = good_ && inside.good();
    return map;
  }

  std::string_view rest() const { return rest_; }
  bool good() const { return good_; }

 private:
  std::string_view rest_;
  bool good_ = true;
};

// --- How a capture is spelled in MCAP, for its writer and its reader. docs/formats.md has the table.

// A metadata record of this name for each topic of images: `topic`, and what a capture's root says.
inline constexpr const char* kCapture = "bolo-capture";
inline constexpr std::string_view kText = "text.";      // attributes beyond the format's own
inline constexpr std::string_view kNumber = "number.";  // likewise

// The attribute in a key that begins with `prefix`; empty: none that a capture could have.
inline std::string attribute_in(std::string_view key, std::string_view prefix) {
  constexpr std::array<std::string_view, 9> kOwn{"format",         "version",      "unit",          "scale",   "offset",
                                                 "frame_period_s", "camera_model", "camera_serial", "row_step"};
  constexpr std::size_t kMostBytes = 255;
  if (!key.starts_with(prefix)) return {};
  key.remove_prefix(prefix.size());
  const bool good = key.size() <= kMostBytes && printable(key) == key && std::ranges::find(kOwn, key) == kOwn.end();
  return good ? std::string(key) : std::string();
}

}  // namespace bolo::tools::mcap
