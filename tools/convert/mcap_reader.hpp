// Reads an MCAP file sequentially, without its index. The file is untrusted: lengths, counts and checksums are checked,
// and nothing is unpacked beyond the limit of a chunk.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <zlib.h>

#include "src/capture/capture.hpp"
#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/core/text.hpp"

namespace bolo::tools::mcap {

// --- Elements of MCAP: records of an operation code, a length and fields, all little-endian.
// Source: https://mcap.dev/spec (version 0).

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

// CRC-32, continuing from `before`. Thread: any.
inline std::uint32_t crc_of(std::uint32_t before, std::string_view bytes) {
  return static_cast<std::uint32_t>(crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

using Texts = std::map<std::string, std::string>;

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
  // With a length prefix: a string, an array, a map.
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

// Extracts fields. Once the bytes are exhausted, fields are zero and good() is false.
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

// --- Representation of a capture in MCAP, for writer and reader. docs/formats.md has the table.

// A metadata record of this name for each topic of images: `topic`, and the capture's root attributes.
inline constexpr const char* kCapture = "bolo-capture";
inline constexpr std::string_view kText = "text.";      // attributes outside the format
inline constexpr std::string_view kNumber = "number.";  // likewise

// The attribute name in a key that begins with `prefix`; empty if a capture could not have such an attribute.
inline std::string attribute_in(std::string_view key, std::string_view prefix) {
  constexpr std::size_t kMostBytes = 255;
  if (!key.starts_with(prefix)) return {};
  key.remove_prefix(prefix.size());
  const bool good = key.size() <= kMostBytes && printable(key) == key && !capture::is_own_attribute(key);
  return good ? std::string(key) : std::string();
}

// A topic of CDR messages of one ROS 2 type.
struct Topic {
  std::string name;
  std::string type;  // "sensor_msgs/msg/Image"
};

struct Message {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_ns = 0;
  std::uint64_t record = 0;  // position in the file of its chunk, or of the message itself
  std::uint64_t offset = 0;  // position of its data in there
  std::uint64_t bytes = 0;
};

// Errors (kBadInput) state the fault and its position, without the file's name. Thread: any one at a time.
class Reader {
 public:
  using Visit = std::function<Status(const Topic&, const Message&, std::string_view data)>;

  static Result<Reader> open(const std::filesystem::path& file);

  // Call once: visits all CDR messages in the file's order; `data` is valid during the call only.
  Status walk(const Visit& visit);
  // The data of a visited message; valid until the next call.
  Result<std::string_view> data(const Message& message);

  std::uint64_t size() const { return size_; }  // of the file

  // Valid after walk(): metadata records by name; a name may occur several times.
  const std::multimap<std::string, Texts>& metadata() const { return metadata_; }

 private:
  struct Head {
    Op op = Op::kHeader;
    std::uint64_t bytes = 0;
  };

  Reader(std::ifstream file, std::uint64_t size) : file_(std::move(file)), size_(size) {}
  Result<std::string_view> take(std::uint64_t bytes, std::string& into);
  Status skip(std::uint64_t bytes);
  Result<Head> next_head();
  Status see(Op op, std::string_view fields, std::uint64_t at, const Visit& visit);
  Status see_channel(std::string_view fields);
  Status see_message(std::string_view fields, const Message& place, const Visit& visit);
  Status see_chunk(std::string_view fields, std::uint64_t at, const Visit& visit);
  Result<std::string_view> unpack(std::string_view chunk);

  std::ifstream file_;
  std::uint64_t size_;
  std::uint64_t at_ = 0;   // consumed so far
  std::uint32_t crc_ = 0;  // of the consumed bytes
  std::map<std::uint16_t, std::string> types_;
  std::map<std::uint16_t, std::optional<Topic>> topics_;  // nothing: not CDR
  std::multimap<std::string, Texts> metadata_;
  std::string record_;    // the current record
  std::string unpacked_;  // the chunk at `unpacked_at_`
  std::optional<std::uint64_t> unpacked_at_;
};

// --- Writes an MCAP file: chunks compressed by zstd, each with an index of its messages, and a summary at the end.

// Writes beside the final name until finish(). Errors: a full or failing disk (kFailed). Thread: any one at a time.
class Writer {
 public:
  static Result<Writer> create(OutputFile output, std::string_view library);

  // Call before the first message.
  Status add_metadata(const std::string& name, const Texts& values);
  // Adds a topic with CDR messages of one ROS 2 type ("sensor_msgs/msg/Image"); returns the channel's number.
  // `definition`: of the type, ros2msg; must be equal for all channels of the type.
  Result<std::uint16_t> add_channel(const std::string& topic, const std::string& type, const std::string& definition);

  Status write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t time_ns, std::string_view data);
  Status finish();

 private:
  struct Place {
    std::uint64_t at = 0;
    std::uint64_t bytes = 0;
  };
  struct Chunk {
    Fields records;
    std::uint64_t first_ns = 0;
    std::uint64_t last_ns = 0;
    std::map<std::uint16_t, Fields> index;  // times and offsets of each channel's messages
  };

  Writer(FileBeside file, std::string name) : file_(std::move(file)), name_(std::move(name)) {}
  Status put(std::string_view bytes);
  Result<Place> put_record(Op op, const Fields& fields);
  Status end_chunk();
  Fields statistics() const;
  Status write_summary();

  FileBeside file_;
  std::string name_;
  std::uint64_t written_ = 0;
  std::uint32_t crc_ = 0;  // of the current section
  std::map<std::string, std::uint16_t> schema_of_type_;
  std::map<Op, std::vector<Fields>> summary_;
  Chunk chunk_;
  std::uint32_t chunks_ = 0;
  std::uint64_t first_ns_ = 0;
  std::uint64_t last_ns_ = 0;
  std::map<std::uint16_t, std::uint64_t> messages_;  // number of messages by channel
  std::string compressed_;
};

}  // namespace bolo::tools::mcap
