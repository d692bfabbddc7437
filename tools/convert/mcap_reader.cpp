#include "tools/convert/mcap_reader.hpp"

#include <zstd.h>

#include <algorithm>
#include <utility>

#include "src/core/input_file.hpp"

namespace bolo::tools::mcap {
namespace {

constexpr std::size_t kChunkBytes = std::size_t{4} << 20U;  // a reader has to unpack this much to see one frame
constexpr int kLevel = 1;                                   // higher levels save only 1 to 2 % on thermal frames

// Chunks usually hold 1 to 4 MiB; one with a single large message may hold more.
constexpr std::uint64_t kMostRecord = std::uint64_t{256} << 20U;
constexpr std::uint64_t kPiece = std::uint64_t{1} << 20U;
constexpr std::size_t kMessageHead = 22;  // size of a message's fields before its data
constexpr std::size_t kMostTopics = 4096;
constexpr std::size_t kLongestName = 200;

tl::unexpected<Error> damaged(std::uint64_t at, const std::string& what) {
  return bad_input("damaged at byte " + std::to_string(at) + ": " + what);
}

}  // namespace

Result<Reader> Reader::open(const std::filesystem::path& name) {
  ASSIGN_OR_RETURN(std::ifstream file, stream_input(name));
  file.seekg(0, std::ios::end);
  const std::streamoff size = file ? static_cast<std::streamoff>(file.tellg()) : -1;
  if (size < 0) return bad_input("cannot be read");
  file.seekg(0);
  Reader reader(std::move(file), static_cast<std::uint64_t>(size));
  const auto magic = reader.take(kMagic.size(), reader.record_);
  if (!magic || *magic != kMagic) return bad_input("is not an MCAP file");
  return reader;
}

Result<std::string_view> Reader::take(std::uint64_t bytes, std::string& into) {
  if (bytes > size_ - at_)
    return bad_input("ends in the middle, at byte " + std::to_string(size_) + ": it was cut off or never finished");
  into.resize(static_cast<std::size_t>(bytes));
  if (!file_.read(into.data(), static_cast<std::streamsize>(bytes))) {
    return failed("cannot be read at byte " + std::to_string(at_));
  }
  crc_ = crc_of(crc_, into);
  at_ += bytes;
  return std::string_view(into);
}

Status Reader::skip(std::uint64_t bytes) {
  for (std::uint64_t left = bytes; left > 0; left -= std::min(left, kPiece)) {
    RETURN_IF_ERROR(take(std::min(left, kPiece), record_));
  }
  return {};
}

Result<Reader::Head> Reader::next_head() {
  ASSIGN_OR_RETURN(const auto bytes, take(kRecordHead, record_));
  FieldReader fields(bytes);
  const auto op = static_cast<Op>(fields.number<std::uint8_t>());
  return Head{op, fields.number<std::uint64_t>()};
}

Status Reader::walk(const Visit& visit) {
  for (;;) {
    const std::uint64_t at = at_;
    const std::uint32_t crc = crc_;
    ASSIGN_OR_RETURN(const Head head, next_head());
    if (head.op == Op::kFooter) return {};  // no end-of-data record: accepted
    const bool known = head.op == Op::kSchema || head.op == Op::kChannel || head.op == Op::kMessage ||
                       head.op == Op::kChunk || head.op == Op::kMetadata || head.op == Op::kDataEnd;
    if (!known) {
      if (Status good = skip(head.bytes); !good) return good;
      continue;
    }
    if (head.bytes > kMostRecord) return damaged(at, "a record of " + std::to_string(head.bytes) + " bytes");
    ASSIGN_OR_RETURN(const auto fields, take(head.bytes, record_));
    if (head.op == Op::kDataEnd) {
      const auto stated = FieldReader(fields).number<std::uint32_t>();
      return stated == 0 || stated == crc ? Status{} : bad_input("damaged: its checksum does not hold");
    }
    if (Status good = see(head.op, fields, at, visit); !good) return good;
  }
}

Status Reader::see(Op op, std::string_view fields, std::uint64_t at, const Visit& visit) {
  FieldReader reader(fields);
  switch (op) {
    case Op::kSchema: {
      const auto id = reader.number<std::uint16_t>();
      types_.insert_or_assign(id, std::string(reader.text().substr(0, kLongestName)));
      break;
    }
    case Op::kChannel:
      return see_channel(fields);
    case Op::kMetadata: {
      const std::string name(reader.text());
      metadata_.emplace(name, reader.texts());
      break;
    }
    case Op::kMessage:
      return see_message(fields, {.record = at, .offset = kMessageHead}, visit);
    case Op::kChunk:
      return see_chunk(fields, at, visit);
    default:
      break;
  }
  return reader.good() ? Status{} : damaged(at, "a record is shorter than it says");
}

Status Reader::see_channel(std::string_view fields) {
  FieldReader reader(fields);
  const auto id = reader.number<std::uint16_t>();
  const auto schema = reader.number<std::uint16_t>();
  const std::string_view topic = reader.text();
  const std::string_view encoding = reader.text();
  if (!reader.good()) return bad_input("damaged: a channel is shorter than it says");
  if (topics_.size() >= kMostTopics && !topics_.contains(id)) return bad_input("has too many topics");
  const auto type = types_.find(schema);
  std::optional<Topic>& known = topics_[id];
  known.reset();
  if (encoding == "cdr" && type != types_.end()) known = Topic{printable(topic.substr(0, kLongestName)), type->second};
  return {};
}

Status Reader::see_message(std::string_view fields, const Message& place, const Visit& visit) {
  FieldReader reader(fields);
  Message message = place;
  message.channel = reader.number<std::uint16_t>();
  message.sequence = reader.number<std::uint32_t>();
  message.log_ns = reader.number<std::uint64_t>();
  reader.number<std::uint64_t>();
  if (!reader.good()) return damaged(place.record, "a message is shorter than it says");
  message.bytes = reader.rest().size();
  const auto topic = topics_.find(message.channel);
  if (topic == topics_.end()) return damaged(place.record, "a message of no topic");
  return topic->second ? visit(*topic->second, message, reader.rest()) : Status{};
}

Status Reader::see_chunk(std::string_view fields, std::uint64_t at, const Visit& visit) {
  const auto records = unpack(fields);
  if (!records) return damaged(at, records.error().message);
  unpacked_at_ = at;
  FieldReader reader(*records);
  while (!reader.rest().empty()) {
    const auto op = static_cast<Op>(reader.number<std::uint8_t>());
    const std::string_view inside = reader.raw(reader.number<std::uint64_t>());
    if (!reader.good()) return damaged(at, "a chunk is shorter than its records");
    const auto offset = static_cast<std::uint64_t>(inside.data() - records->data());
    Status good;
    if (op == Op::kMessage) good = see_message(inside, {.record = at, .offset = offset + kMessageHead}, visit);
    if (op == Op::kSchema || op == Op::kChannel) good = see(op, inside, at, visit);
    if (!good) return good;
  }
  return {};
}

Result<std::string_view> Reader::unpack(std::string_view chunk) {
  FieldReader reader(chunk);
  reader.number<std::uint64_t>();
  reader.number<std::uint64_t>();
  const auto size = reader.number<std::uint64_t>();
  const auto crc = reader.number<std::uint32_t>();
  const std::string_view compression = reader.text();
  const std::string_view packed = reader.raw(reader.number<std::uint64_t>());
  if (!reader.good()) return bad_input("a chunk is shorter than it says");
  if (size > kMostRecord) return bad_input("a chunk of " + std::to_string(size) + " bytes");
  if (compression.empty()) {
    unpacked_ = packed;
  } else if (compression == "zstd") {
    // Refuses a frame that states another size before allocating memory for it.
    const unsigned long long stated = ZSTD_getFrameContentSize(packed.data(), packed.size());
    if (stated == ZSTD_CONTENTSIZE_ERROR || (stated != ZSTD_CONTENTSIZE_UNKNOWN && stated > size)) {
      return bad_input("a chunk does not unpack");
    }
    unpacked_.resize(static_cast<std::size_t>(size));
    const std::size_t done = ZSTD_decompress(unpacked_.data(), unpacked_.size(), packed.data(), packed.size());
    if (ZSTD_isError(done) != 0) return bad_input(std::string("a chunk does not unpack: ") + ZSTD_getErrorName(done));
    unpacked_.resize(done);
  } else {
    return bad_input("a chunk is packed by '" + printable(compression.substr(0, 20)) + "'; expected zstd or none");
  }
  if (unpacked_.size() != size) return bad_input("a chunk unpacks to another size than it says");
  if (crc != 0 && crc != crc_of(0, unpacked_)) return bad_input("a chunk's checksum does not hold");
  return std::string_view(unpacked_);
}

Result<std::string_view> Reader::data(const Message& message) {
  if (unpacked_at_ != message.record) {
    unpacked_at_.reset();
    file_.clear();
    file_.seekg(static_cast<std::streamoff>(message.record));
    at_ = message.record;
    ASSIGN_OR_RETURN(const Head head, next_head());
    if (head.bytes > kMostRecord) return bad_input("the file was changed meanwhile");
    ASSIGN_OR_RETURN(const auto fields, take(head.bytes, record_));
    if (head.op == Op::kChunk) {
      RETURN_IF_ERROR(unpack(fields));
    } else {
      unpacked_ = fields;
    }
    unpacked_at_ = message.record;
  }
  FieldReader reader(unpacked_);
  reader.raw(message.offset);
  const std::string_view bytes = reader.raw(message.bytes);
  if (!reader.good()) return bad_input("the file was changed meanwhile");
  return bytes;
}

Result<Writer> Writer::create(OutputFile output, std::string_view library) {
  std::string name = output.path.string();
  ASSIGN_OR_RETURN(FileBeside file, FileBeside::create(std::move(output)));
  Writer writer(std::move(file), std::move(name));
  RETURN_IF_ERROR(writer.put(kMagic));
  RETURN_IF_ERROR(writer.put_record(Op::kHeader, Fields().text("ros2").text(library)));
  return writer;
}

Status Writer::put(std::string_view bytes) {
  written_ += bytes.size();
  crc_ = crc_of(crc_, bytes);
  return file_.write(bytes);
}

Result<Writer::Place> Writer::put_record(Op op, const Fields& fields) {
  const Place place{written_, kRecordHead + fields.size()};
  RETURN_IF_ERROR(put(Fields().number(static_cast<std::uint8_t>(op)).number(std::uint64_t{fields.size()}).bytes()));
  RETURN_IF_ERROR(put(fields.bytes()));
  return place;
}

Status Writer::add_metadata(const std::string& name, const Texts& values) {
  ASSIGN_OR_RETURN(const auto place, put_record(Op::kMetadata, Fields().text(name).texts(values)));
  summary_[Op::kMetadataIndex].push_back(Fields().number(place.at).number(place.bytes).text(name));
  return {};
}

Result<std::uint16_t> Writer::add_channel(const std::string& topic, const std::string& type,
                                          const std::string& definition) {
  const auto [schema, is_new] = schema_of_type_.emplace(type, static_cast<std::uint16_t>(schema_of_type_.size() + 1));
  if (is_new) {
    Fields fields;
    fields.number(schema->second).text(type).text("ros2msg").text(definition);
    RETURN_IF_ERROR(put_record(Op::kSchema, fields));
    summary_[Op::kSchema].push_back(std::move(fields));
  }
  const auto id = static_cast<std::uint16_t>(summary_[Op::kChannel].size());
  Fields fields;
  fields.number(id).number(schema->second).text(topic).text("cdr").texts({{"offered_qos_profiles", ""}});
  RETURN_IF_ERROR(put_record(Op::kChannel, fields));
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
  ASSIGN_OR_RETURN(const auto chunk, put_record(Op::kChunk, fields));
  Fields offsets;
  const std::uint64_t index_at = written_;
  for (const auto& [channel, index] : chunk_.index) {
    ASSIGN_OR_RETURN(const auto place, put_record(Op::kMessageIndex, Fields().number(channel).text(index.bytes())));
    offsets.number(channel).number(place.at);
  }
  Fields entry;
  entry.number(chunk_.first_ns).number(chunk_.last_ns).number(chunk.at).number(chunk.bytes);
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

// Groups of records of one code, followed by the position of each group.
Status Writer::write_summary() {
  const std::uint64_t start = written_;
  crc_ = 0;
  Fields offsets;
  summary_[Op::kStatistics].push_back(statistics());
  for (const Op op : {Op::kSchema, Op::kChannel, Op::kStatistics, Op::kChunkIndex, Op::kMetadataIndex}) {
    const std::uint64_t group = written_;
    for (const Fields& fields : summary_[op]) {
      RETURN_IF_ERROR(put_record(op, fields));
    }
    if (written_ == group) continue;
    Fields place;
    place.number(static_cast<std::uint8_t>(op)).number(group).number(written_ - group);
    offsets.record(Op::kSummaryOffset, place);
  }
  const std::uint64_t offsets_at = written_;
  constexpr std::uint64_t kFooterBytes = 20;
  RETURN_IF_ERROR(put(offsets.bytes()));
  RETURN_IF_ERROR(put(Fields().number(static_cast<std::uint8_t>(Op::kFooter)).number(kFooterBytes).bytes()));
  RETURN_IF_ERROR(put(Fields().number(start).number(offsets_at).bytes()));
  RETURN_IF_ERROR(put(Fields().number(crc_).bytes()));
  return put(kMagic);
}

Status Writer::finish() {
  if (Status good = end_chunk(); !good) return good;
  RETURN_IF_ERROR(put_record(Op::kDataEnd, Fields().number(crc_)));
  if (Status good = write_summary(); !good) return good;
  return file_.publish();
}

}  // namespace bolo::tools::mcap
