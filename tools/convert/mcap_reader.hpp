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

}  // namespace bolo::tools::mcap
