#include "drivers/genicam/description.hpp"

#include <sys/mman.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <map>
#include <string>
#include <string_view>
#include <utility>

#include "src/core/text.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::genicam {
namespace {

using Bytes = std::vector<unsigned char>;

thread_local UniqueFd given;  // description for Aravis on this thread, a file in memory

constexpr std::uint32_t kUrlBytes = 512;
constexpr std::uint32_t kReadBytes = 512;
constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20U;  // descriptions have 0.1 to 5 MB
constexpr std::uint64_t kMemoryEnd = std::uint64_t{1} << 32U;   // 32-bit camera addresses

// Reads `bytes` from any `address`, aligned or not, of the camera's memory.
std::optional<Bytes> read_some(const ReadMemory& read, std::uint64_t address, std::uint64_t bytes) {
  const std::uint64_t before = address % 4;
  Bytes out;
  for (std::uint64_t at = address - before; at < address + bytes; at += kReadBytes) {
    const auto count = std::min<std::uint64_t>(kReadBytes, (address + bytes - at + 3) / 4 * 4);
    auto part = read(static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(count));
    if (!part) part = read(static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(count));  // lossy network
    if (!part || part->size() != count) return std::nullopt;
    out.insert(out.end(), part->begin(), part->end());
  }
  out.erase(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(before));
  out.resize(bytes);
  return out;
}

tl::unexpected<Error> too_large(const std::string& what) {
  return bad_input(what + ", more than any description: this is no camera, or a damaged one");
}

tl::unexpected<Error> damaged_zip() {
  return bad_input("its GenICam description is in a damaged ZIP file: this is no camera, or a damaged one");
}

// A ZIP file; unpack() returns the content of its last entry, which is the one that Aravis takes.
class ZipFile {
 public:
  explicit ZipFile(const Bytes& bytes) : bytes_(bytes) {}

  Result<Bytes> unpack() const {
    constexpr std::string_view kEnd = "PK\x05\x06";
    constexpr std::int64_t kEndBytes = 22;
    constexpr std::int64_t kEntryBytes = 46;  // without the name
    constexpr std::int64_t kLocalBytes = 30;  // header before the packed data, without the name
    const auto found = std::find_end(bytes_.begin(), bytes_.end(), kEnd.begin(), kEnd.end());
    const std::int64_t end = found - bytes_.begin();
    if (!holds(end, kEndBytes)) return damaged_zip();
    std::int64_t entry = end - number(end + 12, 4);
    const std::int64_t start = entry - number(end + 16, 4);  // origin of the offsets in the file
    for (std::int64_t left = number(end + 10, 2); left > 1 && holds(entry, kEntryBytes); --left) {
      entry += kEntryBytes + number(entry + 28, 2) + number(entry + 30, 2) + number(entry + 32, 2);
    }
    if (!holds(entry, kEntryBytes)) return damaged_zip();
    const std::int64_t local = start + number(entry + 42, 4);
    if (!holds(local, kLocalBytes)) return damaged_zip();
    const std::int64_t at = local + kLocalBytes + number(local + 26, 2) + number(local + 28, 2);
    return content(at, number(entry + 10, 2) == 0, number(entry + 20, 4), number(entry + 24, 4));
  }

 private:
  bool holds(std::int64_t at, std::int64_t bytes) const {
    return at >= 0 && at + bytes <= static_cast<std::int64_t>(bytes_.size());
  }

  std::int64_t number(std::int64_t at, int size) const {
    std::int64_t value = 0;
    while (size-- > 0) value = value << 8U | bytes_[static_cast<std::size_t>(at + size)];
    return value;
  }

  Result<Bytes> content(std::int64_t at, bool stored, std::int64_t packed, std::int64_t unpacked) const {
    if (static_cast<std::uint64_t>(unpacked) > kMostBytes) {
      return too_large("its GenICam description unpacks to " + std::to_string(unpacked) + " bytes");
    }
    if (!holds(at, packed)) return damaged_zip();
    const unsigned char* const first = bytes_.data() + at;
    if (stored) return Bytes(first, first + packed);
    Bytes out(static_cast<std::size_t>(unpacked));
    z_stream stream{};
    if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) return failed("no memory to unpack its GenICam description");
    stream.next_in = const_cast<Bytef*>(first);
    stream.avail_in = static_cast<uInt>(packed);
    stream.next_out = out.data();
    stream.avail_out = static_cast<uInt>(unpacked);
    const bool whole = inflate(&stream, Z_FINISH) == Z_STREAM_END && stream.avail_out == 0;
    inflateEnd(&stream);
    if (!whole) return damaged_zip();
    return out;
  }

  const Bytes& bytes_;
};

// `url`: "local:NAME;ADDRESS;SIZE", both hexadecimal. Other schemes are refused: they name files outside the camera.
Result<Bytes> read_file(const ReadMemory& read, std::string url) {
  std::ranges::transform(url, url.begin(), [](unsigned char c) { return c >= 'A' && c <= 'Z' ? c + 32 : c; });
  const std::string shown = printable(url.substr(0, 80));
  if (!url.starts_with("local:")) {
    return bad_input("its GenICam description is no file of its own, but of this computer or another: " + shown);
  }
  const std::size_t first = std::min(url.find(';'), url.size());
  const std::size_t second = std::min(url.find(';', first + 1), url.size());
  // Negative numbers and those beyond 64 bits saturate to the maximum.
  const auto number = [&](std::size_t at) -> std::uint64_t {
    const char* const text = url.c_str() + std::min(at + 1, url.size());
    const std::string_view digits(text, std::strcspn(text, ";?"));
    return digits.find('-') != std::string_view::npos ? UINT64_MAX : std::strtoull(text, nullptr, 16);
  };
  const std::uint64_t address = number(first);
  const std::uint64_t bytes = number(second);
  if (bytes > kMostBytes) {
    return too_large("its GenICam description is said to have " + std::to_string(bytes) + " bytes");
  }
  if (bytes == 0 || address >= kMemoryEnd || address + bytes > kMemoryEnd) {
    return bad_input("its GenICam description is where no camera has one (" + shown +
                     "): this is no camera, or a damaged one");
  }
  auto file = read_some(read, address, bytes);
  if (!file) return failed("its GenICam description cannot be read from it (" + shown + ")");
  if (url.substr(0, first).ends_with(".zip")) return ZipFile(*file).unpack();
  return *std::move(file);
}

// Other encodings could hide from check_attributes() quotes that the XML library sees. The encoding follows from the
// first bytes or is quoted in the declaration, where the only other quoted words are versions and "yes" or "no".
Status check_encoding(const Bytes& description) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";  // byte order mark of UTF-8
  constexpr std::array<std::string_view, 10> kKnown{"1.0",  "1.1",      "yes",   "no",         "utf-8",
                                                    "utf8", "us-ascii", "ascii", "iso-8859-1", "windows-1252"};
  std::string_view text(reinterpret_cast<const char*>(description.data()), description.size());
  if (text.starts_with(kMark)) text.remove_prefix(kMark.size());
  bool good = std::ranges::all_of(text.substr(0, 4), [](unsigned char c) { return c > 0 && c < 0x80; });
  std::string head(text.starts_with("<?xml") ? text.substr(0, text.find("?>")) : "");
  std::ranges::transform(head, head.begin(), [](unsigned char c) { return c >= 'A' && c <= 'Z' ? c + 32 : c; });
  for (std::size_t at = 0; (at = head.find_first_of("\"'", at)) != std::string::npos;) {
    const std::size_t end = head.find(head[at], at + 1);
    good = good && std::ranges::find(kKnown, head.substr(at + 1, end - at - 1)) != kKnown.end();
    at = end == std::string::npos ? end : end + 1;
  }
  if (good) return {};
  return bad_input("its GenICam description is no XML in UTF-8, ASCII or Latin-1: this is no camera, or a damaged one");
}

// The XML library compares each attribute of an element with all others: 200,000 took 19 s. Counts quotes up to the
// next '<', which cannot occur in an attribute's value.
Status check_attributes(const Bytes& description) {
  constexpr int kMostQuotes = 1000;  // real elements have a few attributes
  int quotes = 0;
  for (const unsigned char byte : description) {
    if (byte == '<') quotes = 0;
    if (byte != '"' && byte != '\'') continue;
    if (++quotes > kMostQuotes) return too_large("its GenICam description has an element of hundreds of attributes");
  }
  return {};
}

Result<Bytes> read_description(const ReadMemory& read) {
  std::optional<Error> error;
  for (const std::uint32_t place : {0x200U, 0x400U}) {
    const auto text = read_some(read, place, kUrlBytes);
    if (!text || text->front() == 0) continue;
    auto description = read_file(read, std::string(text->begin(), std::ranges::find(*text, 0)));
    if (description) return description;
    if (!error) error = std::move(description).error();
  }
  if (error) return tl::unexpected<Error>(*std::move(error));
  return failed("it does not say where its GenICam description is: check its cable and power");
}

constexpr int kMostDeep = 100;
constexpr double kMostSteps = 1e5;
constexpr long long kMostRegisterBytes = 1 << 16;
constexpr std::size_t kMostFormulaBytes = 1 << 13;  // Aravis needs kilobytes of memory per byte of a formula

// References from which a node's value is computed. References for limits, access and selected features are evaluated
// separately, and may legitimately lead back to the node.
constexpr std::array<std::string_view, 8> kTakenFrom{"pValue",        "pVariable", "pIndex",  "pValueIndexed",
                                                     "pValueDefault", "pAddress",  "pLength", "pOffset"};

std::string text_of(ArvDomNode* node) {
  std::string text;
  for (ArvDomNode* child = arv_dom_node_get_first_child(node); child != nullptr;
       child = arv_dom_node_get_next_sibling(child)) {
    const char* part = arv_dom_node_get_node_value(child);
    if (part != nullptr) text += part;
  }
  return text;
}

// Plain registers, which hold files and tables of any length, are not read.
bool has_good_length(std::string_view kind, std::string_view tag, const std::string& length) {
  if (kind == "Register") return true;
  const long long bytes = std::strtoll(length.c_str(), nullptr, 0);
  return tag == "Length" && bytes > 0 && bytes <= kMostRegisterBytes;
}

// Cost of evaluating a value.
struct Effort {
  double steps = 1.0;
  int deep = 0;  // nesting depth
};

class Description {
 public:
  explicit Description(ArvGc* description) {
    collect(ARV_DOM_NODE(arv_dom_document_get_document_element(ARV_DOM_DOCUMENT(description))), {});
  }

  Status check() {
    if (!bad_length_.empty()) {
      return bad_input("its GenICam description has registers of impossible lengths, such as " +
                       printable(bad_length_.substr(0, 80)));
    }
    if (!long_formula_.empty()) {
      return bad_input("its GenICam description has formulas without an end, such as " +
                       printable(long_formula_.substr(0, 80)));
    }
    for (const auto& [name, ignored] : taken_from_) {
      if (!effort_of(name, 0)) {
        return bad_input("its GenICam description has values without an end, such as " + printable(name.substr(0, 80)));
      }
    }
    return {};
  }

 private:
  // Recursion depth: that of the document, which its parser limits. `owners`: named nodes around `node`.
  void collect(ArvDomNode* node, std::vector<std::string> owners) {
    if (node == nullptr || !ARV_IS_DOM_ELEMENT(node)) return;
    const std::string_view tag = arv_dom_node_get_node_name(node);
    if (tag == "Length" || tag == "pLength") {
      const char* const kind = arv_dom_node_get_node_name(arv_dom_node_get_parent_node(node));
      if (!has_good_length(kind, tag, text_of(node))) bad_length_ = owners.empty() ? kind : owners.back();
    }
    if ((tag.starts_with("Formula") || tag == "Expression") && text_of(node).size() > kMostFormulaBytes) {
      long_formula_ = owners.empty() ? tag : owners.back();
    }
    if (std::ranges::find(kTakenFrom, tag) != kTakenFrom.end()) {
      const std::string from = text_of(node);
      for (const std::string& owner : owners) taken_from_[owner].push_back(from);
      return;
    }
    const char* const name = arv_dom_element_get_attribute(ARV_DOM_ELEMENT(node), "Name");
    if (name != nullptr) owners.emplace_back(name);
    for (ArvDomNode* child = arv_dom_node_get_first_child(node); child != nullptr;
         child = arv_dom_node_get_next_sibling(child)) {
      collect(child, owners);
    }
  }

  // Nothing: the evaluation is endless or takes too many steps. `within`: current nesting depth.
  std::optional<Effort> effort_of(const std::string& name, int within) {
    const auto found = taken_from_.find(name);
    if (found == taken_from_.end()) return Effort{};
    if (const auto known = efforts_.find(name); known != efforts_.end()) return known->second;
    Effort effort;
    for (const std::string& from : found->second) {
      const auto more = within < kMostDeep ? effort_of(from, within + 1) : std::nullopt;
      if (!more) return std::nullopt;
      effort.steps += more->steps;
      effort.deep = std::max(effort.deep, more->deep + 1);
    }
    if (effort.steps > kMostSteps || effort.deep > kMostDeep) return std::nullopt;
    efforts_.emplace(name, effort);
    return effort;
  }

  std::map<std::string, std::vector<std::string>> taken_from_;  // by name
  std::map<std::string, Effort> efforts_;                       // of values that pass
  std::string bad_length_;                                      // owner of the offending element
  std::string long_formula_;                                    // likewise
};

}  // namespace

Status take_description(const ReadMemory& read) {
  given = UniqueFd();
  ASSIGN_OR_RETURN(const Bytes description, read_description(read));
  RETURN_IF_ERROR(check_encoding(description));
  RETURN_IF_ERROR(check_attributes(description));
  UniqueFd file(memfd_create("GenICam description", MFD_CLOEXEC));
  if (!file || write(file.get(), description.data(), description.size()) != std::ssize(description)) {
    return failed(std::string("its GenICam description cannot be kept in memory (") + std::strerror(errno) + ")");
  }
  given = std::move(file);
  return {};
}

Status check_description(ArvGc* description) {
  return description != nullptr ? Description(description).check() : Status{};  // without one nothing is evaluated
}

}  // namespace bolo::genicam

// Replaces Aravis's parser of the description URL stated by the camera: always the copy taken and checked above.
extern "C" gboolean arv_parse_genicam_url(const char* /*url*/, gssize /*length*/, char** scheme, char** /*authority*/,
                                          char** path, char** /*query*/, char** /*fragment*/, guint64* /*address*/,
                                          guint64* /*size*/) {
  if (scheme != nullptr) *scheme = g_strdup("file");
  if (path != nullptr) *path = g_strdup_printf("/proc/self/fd/%d", bolo::genicam::given.get());
  return TRUE;
}
