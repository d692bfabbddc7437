// Writes an MCAP file: chunks compressed by zstd, each with an index of its messages, and a summary of all at the end.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/output_file.hpp"
#include "tools/convert/mcap_records.hpp"

namespace bolo::tools::mcap {

// What a topic carries: messages in CDR of a ROS 2 type.
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
