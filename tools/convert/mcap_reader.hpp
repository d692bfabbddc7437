// Reads an MCAP file from its first record to its last, whatever its index says. The file is anybody's: lengths, counts
// and checksums are checked, and nothing is unpacked beyond what a chunk may hold.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "tools/convert/mcap_records.hpp"

namespace bolo::tools::mcap {

// A topic of messages in CDR of a ROS 2 type.
struct Topic {
  std::string name;
  std::string type;  // "sensor_msgs/msg/Image"
};

struct Message {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_ns = 0;
  std::uint64_t record = 0;  // of the file: its chunk, or the message itself
  std::uint64_t offset = 0;  // of its data in there
  std::uint64_t bytes = 0;
};

// Errors (kBadInput) say what is wrong and where, without the file's name. Thread: any one at a time.
class Reader {
 public:
  using Visit = std::function<Status(const Topic&, const Message&, std::string_view data)>;

  static Result<Reader> open(const std::filesystem::path& file);

  // Once: every message that is in CDR, in the file's order, with its data, which is good for the call only.
  Status walk(const Visit& visit);
  // The data of a message that was visited; good until the next call.
  Result<std::string_view> data(const Message& message);

  // After walk(): metadata records by name; of several of one name all.
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
  std::uint64_t at_ = 0;   // bytes taken
  std::uint32_t crc_ = 0;  // of them
  std::map<std::uint16_t, std::string> types_;
  std::map<std::uint16_t, std::optional<Topic>> topics_;  // nothing: not in CDR
  std::multimap<std::string, Texts> metadata_;
  std::string record_;    // in work
  std::string unpacked_;  // of the chunk at `unpacked_at_`
  std::optional<std::uint64_t> unpacked_at_;
};

// --- Writes an MCAP file: chunks compressed by zstd, each with an index of its messages, and a summary of all at the
// end.

// A topic's messages: CDR of a ROS 2 type.
struct Channel {
  std::string topic;
  std::string type;        // "sensor_msgs/msg/Image"
  std::string definition;  // of the type, ros2msg; equal for all channels of the type
};

// Beside its final name until finish(). Errors: a disk that takes no more (kFailed). Thread: any one at a time.
class Writer {
 public:
  static Result<Writer> create(OutputFile output, std::string_view library);

  // Before the first message.
  Status add_metadata(const std::string& name, const Texts& values);
  // The channel's number.
  Result<std::uint16_t> add_channel(const Channel& channel);

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
  std::uint32_t crc_ = 0;  // of the section in work
  std::map<std::string, std::uint16_t> schema_of_type_;
  std::map<Op, std::vector<Fields>> summary_;
  Chunk chunk_;
  std::uint32_t chunks_ = 0;
  std::uint64_t first_ns_ = 0;
  std::uint64_t last_ns_ = 0;
  std::map<std::uint16_t, std::uint64_t> messages_;  // of each channel
  std::string compressed_;
};

}  // namespace bolo::tools::mcap
