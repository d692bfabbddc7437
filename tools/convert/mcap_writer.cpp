#include "tools/convert/mcap_writer.hpp"

#include <algorithm>
#include <utility>

#include <zstd.h>

namespace bolo::tools::mcap {
namespace {

constexpr std::size_t kChunkBytes = std::size_t{4} << 20U;  // what a reader must unpack to see one frame
constexpr int kLevel = 1;                                   // higher ones save 1 to 2 % of thermal frames

}  // namespace

Result<Writer> Writer::create(OutputFile output, std::string_view library) {
  std::string name = output.path.string();
  Result<FileBeside> file = FileBeside::create(std::move(output));
  if (!file) return tl::unexpected<Error>(file.error());
  Writer writer(std::move(*file), std::move(name));
  if (Status good = writer.put(kMagic); !good) return tl::unexpected<Error>(good.error());
  const auto header = writer.put_record(Op::kHeader, Fields().text("ros2").text(library));
  if (!header) return tl::unexpected<Error>(header.error());
  return writer;
}

Status Writer::put(std::string_view bytes) {
  written_ += bytes.size();
  crc_ = crc_of(crc_, bytes);
  return file_.write(bytes);
}

Result<Writer::Place> Writer::put_record(Op op, const Fields& fields) {
  const Place place{written_, kRecordHead + fields.size()};
  Status good = put(Fields().number(static_cast<std::uint8_t>(op)).number(std::uint64_t{fields.size()}).bytes());
  if (good) good = put(fields.bytes());
  if (!good) return tl::unexpected<Error>(good.error());
  return place;
}

Status Writer::add_metadata(const std::string& name, const Texts& values) {
  const auto place = put_record(Op::kMetadata, Fields().text(name).texts(values));
  if (!place) return tl::unexpected<Error>(place.error());
  summary_[Op::kMetadataIndex].push_back(Fields().number(place->at).number(place->bytes).text(name));
  return {};
}

Result<std::uint16_t> Writer::add_channel(const Channel& channel) {
  const auto [schema, is_new] =
      schema_of_type_.emplace(channel.type, static_cast<std::uint16_t>(schema_of_type_.size() + 1));
  if (is_new) {
    Fields fields;
    fields.number(schema->second).text(channel.type).text("ros2msg").text(channel.definition);
    if (auto put = put_record(Op::kSchema, fields); !put) return tl::unexpected<Error>(put.error());
    summary_[Op::kSchema].push_back(std::move(fields));
  }
  const auto id = static_cast<std::uint16_t>(summary_[Op::kChannel].size());
  Fields fields;
  fields.number(id).number(schema->second).text(channel.topic).text("cdr").texts({{"offered_qos_profiles", ""}});
  if (auto put = put_record(Op::kChannel, fields); !put) return tl::unexpected<Error>(put.error());
  summary_[Op::kChannel].push_back(std::move(fields));
  messages_[id] = 0;
  return id;
}

Status Writer::write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t time_ns, std::string_view data) {
  const bool first_of_chunk = chunk_.records.size() == 0;
  chunk_.first_ns = first_of_chunk ? time_ns : std::min(chunk_.first_ns, time_ns);
  chunk_.last_ns = std::max(chunk_.last_ns, time_ns);
  chunk_.index[channel].number(time_ns).number(std::uint64_t{chunk_.records.size()});
  ++messages_[channel];
  const std::uint64_t bytes = 22 + data.size();
  chunk_.records.number(static_cast<std::uint8_t>(Op::kMessage)).number(bytes);
  chunk_.records.number(channel).number(sequence).number(time_ns).number(time_ns).raw(data);
  return chunk_.records.size() < kChunkBytes ? Status{} : end_chunk();
}

Status Writer::end_chunk() {
  if (chunk_.records.size() == 0) return {};
  const std::string& records = chunk_.records.bytes();
  compressed_.resize(ZSTD_compressBound(records.size()));
  const std::size_t size =
      ZSTD_compress(compressed_.data(), compressed_.size(), records.data(), records.size(), kLevel);
  if (ZSTD_isError(size) != 0) return failed(name_ + ": zstd: " + ZSTD_getErrorName(size));
  compressed_.resize(size);
  Fields fields;
  fields.number(chunk_.first_ns).number(chunk_.last_ns).number(std::uint64_t{records.size()});
  fields.number(crc_of(0, records)).text("zstd").number(std::uint64_t{size}).raw(compressed_);
  const auto chunk = put_record(Op::kChunk, fields);
  if (!chunk) return tl::unexpected<Error>(chunk.error());
  Fields offsets;
  const std::uint64_t index_at = written_;
  for (const auto& [channel, index] : chunk_.index) {
    const auto place = put_record(Op::kMessageIndex, Fields().number(channel).text(index.bytes()));
    if (!place) return tl::unexpected<Error>(place.error());
    offsets.number(channel).number(place->at);
  }
  Fields entry;
  entry.number(chunk_.first_ns).number(chunk_.last_ns).number(chunk->at).number(chunk->bytes);
  entry.text(offsets.bytes()).number(written_ - index_at).text("zstd");
  entry.number(std::uint64_t{size}).number(std::uint64_t{records.size()});
  summary_[Op::kChunkIndex].push_back(std::move(entry));
  first_ns_ = chunks_ == 0 ? chunk_.first_ns : std::min(first_ns_, chunk_.first_ns);
  last_ns_ = std::max(last_ns_, chunk_.last_ns);
  ++chunks_;
  chunk_.records.clear();
  chunk_.index.clear();
  chunk_.last_ns = 0;
  return {};
}

Fields Writer::statistics() const {
  Fields counts;
  std::uint64_t all = 0;
  for (const auto& [channel, count] : messages_) {
    counts.number(channel).number(count);
    all += count;
  }
  const auto size_of = [&](Op op) {
    const auto found = summary_.find(op);
    return found == summary_.end() ? std::size_t{0} : found->second.size();
  };
  Fields fields;
  fields.number(all).number(static_cast<std::uint16_t>(size_of(Op::kSchema)));
  fields.number(static_cast<std::uint32_t>(size_of(Op::kChannel))).number(std::uint32_t{0});
  fields.number(static_cast<std::uint32_t>(size_of(Op::kMetadataIndex))).number(chunks_);
  fields.number(first_ns_).number(last_ns_).text(counts.bytes());
  return fields;
}

// Groups of records of one code, then where each group lies.
Status Writer::write_summary() {
  const std::uint64_t start = written_;
  crc_ = 0;
  Fields offsets;
  summary_[Op::kStatistics].push_back(statistics());
  for (const Op op : {Op::kSchema, Op::kChannel, Op::kStatistics, Op::kChunkIndex, Op::kMetadataIndex}) {
    const std::uint64_t group = written_;
    for (const Fields& fields : summary_[op]) {
      if (auto put = put_record(op, fields); !put) return tl::unexpected<Error>(put.error());
    }
    if (written_ == group) continue;
    Fields place;
    place.number(static_cast<std::uint8_t>(op)).number(group).number(written_ - group);
    offsets.record(Op::kSummaryOffset, place);
  }
  const std::uint64_t offsets_at = written_;
  constexpr std::uint64_t kFooterBytes = 20;
  Status good = put(offsets.bytes());
  if (good) good = put(Fields().number(static_cast<std::uint8_t>(Op::kFooter)).number(kFooterBytes).bytes());
  if (good) good = put(Fields().number(start).number(offsets_at).bytes());
  if (good) good = put(Fields().number(crc_).bytes());
  return good ? put(kMagic) : good;
}

Status Writer::finish() {
  if (Status good = end_chunk(); !good) return good;
  const auto end = put_record(Op::kDataEnd, Fields().number(crc_));
  if (!end) return tl::unexpected<Error>(end.error());
  if (Status good = write_summary(); !good) return good;
  return file_.publish();
}

}  // namespace bolo::tools::mcap
