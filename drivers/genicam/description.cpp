#include "drivers/genicam/description.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/text.hpp"

namespace bolo::genicam {
namespace {

using Bytes = std::vector<unsigned char>;

thread_local std::vector<std::string> checked_places;  // of the camera that this thread opens

constexpr std::uint32_t kUrlBytes = 512;
constexpr std::uint32_t kReadBytes = 512;
constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20U;  // descriptions have 0.1 to 5 MB
constexpr std::uint64_t kMemoryEnd = std::uint64_t{1} << 32U;   // of a camera
constexpr std::uint32_t kEndBytes = 22;                         // of a ZIP file, without its comment
constexpr std::uint32_t kMostComment = 65535;
constexpr std::uint32_t kEntryBytes = 46;  // without its name
constexpr std::uint32_t kLocalBytes = 30;  // before what is packed, without its name
constexpr std::uint32_t kMostEntries = 64;

std::uint32_t little(const Bytes& bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8U | bytes[at + i];
  return value;
}

// `bytes` from `address` on, wherever that is in the camera's memory.
std::optional<Bytes> read_some(const ReadMemory& read, std::uint64_t address, std::uint64_t bytes) {
  const std::uint64_t before = address % 4;
  Bytes out;
  for (std::uint64_t at = address - before; at < address + bytes; at += kReadBytes) {
    const auto count = std::min<std::uint64_t>(kReadBytes, (address + bytes - at + 3) / 4 * 4);
    const auto part = read(static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(count));
    if (!part || part->size() != count) return std::nullopt;
    out.insert(out.end(), part->begin(), part->end());
  }
  out.erase(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(before));
  out.resize(bytes);
  return out;
}

struct File {
  std::uint64_t address = 0;
  std::uint64_t bytes = 0;
  bool zip = false;
};

// Of "local:NAME;ADDRESS;SIZE", both hexadecimal; nothing for files elsewhere.
std::optional<File> file_of(const std::string& url) {
  const std::size_t first = url.find(';');
  const std::size_t second = first == std::string::npos ? first : url.find(';', first + 1);
  if (!url.starts_with("local:") || second == std::string::npos) return std::nullopt;
  // Negative numbers and those beyond 64 bits become the largest.
  const auto number = [&](std::size_t at) -> std::uint64_t {
    const char* const text = url.c_str() + at + 1;
    const std::string_view digits(text, std::strcspn(text, ";?"));
    return digits.find('-') != std::string_view::npos ? UINT64_MAX : std::strtoull(text, nullptr, 16);
  };
  return File{number(first), number(second), url.substr(0, first).ends_with(".zip")};
}

tl::unexpected<Error> too_large(const std::string& what) {
  return bad_input(what + ", more than any description: this is no camera, or a damaged one");
}

// Refuses files that are not the camera's own, which Aravis would fetch by any means (http: it does not), and addresses
// that it parses otherwise than file_of(): the last of several, or the lower half of a long number.
Status check_place(const std::string& url, const std::optional<File>& file) {
  const std::string shown = printable(url.substr(0, 80));
  const std::size_t colon = url.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789+-.");
  const std::string_view scheme = std::string_view(url).substr(0, colon);
  if (colon != 0 && colon != std::string::npos && url[colon] == ':' && scheme != "local" && scheme != "http") {
    return bad_input("its GenICam description is no file of its own, but of this computer or another: " + shown);
  }
  const bool many = scheme == "local" && std::ranges::count(url, ';') > 2;
  if (!many && (!file || (file->address < kMemoryEnd && file->address + file->bytes <= kMemoryEnd))) return {};
  return bad_input("its GenICam description is where no camera has one (" + shown +
                   "): this is no camera, or a damaged one");
}

tl::unexpected<Error> damaged_zip() {
  return bad_input("its GenICam description is in a damaged ZIP file: this is no camera, or a damaged one");
}

// ZIP's record of the end of the directory, and its place in the file.
struct DirectoryEnd {
  Bytes bytes;  // fewer than it has where the file ends
  std::int64_t at = 0;
};

// Nothing when there is none.
std::optional<DirectoryEnd> end_of(const ReadMemory& read, const File& file) {
  for (const std::uint64_t reach : {std::uint64_t{kReadBytes}, std::uint64_t{kEndBytes + kMostComment}}) {
    const std::uint64_t bytes = std::min(file.bytes, reach);
    const auto more = read_some(read, file.address + file.bytes - bytes, bytes);
    if (!more) return std::nullopt;
    constexpr std::string_view kSignature = "PK\x05\x06";
    const auto found = std::find_end(more->begin(), more->end(), kSignature.begin(), kSignature.end());
    const auto left = std::min(std::distance(found, more->end()), std::ptrdiff_t{kEndBytes});
    if (left > 0) {
      return DirectoryEnd{Bytes(found, found + left),
                          static_cast<std::int64_t>(file.bytes - bytes) + std::distance(more->begin(), found)};
    }
    if (bytes == file.bytes) break;
  }
  return std::nullopt;
}

bool is_inside(const File& file, std::int64_t at, std::uint64_t bytes) {
  return at >= 0 && static_cast<std::uint64_t>(at) + bytes <= file.bytes;
}

// `start`: what the file's own places count from.
Status check_entry(const ReadMemory& read, const File& file, std::int64_t start, const Bytes& entry) {
  const std::uint32_t unpacked = little(entry, 24, 4);
  if (unpacked > kMostBytes) {
    return too_large("its GenICam description unpacks to " + std::to_string(unpacked) + " bytes");
  }
  const std::int64_t at = start + little(entry, 42, 4);
  if (!is_inside(file, at, kLocalBytes)) return damaged_zip();
  const auto local = read_some(read, file.address + static_cast<std::uint64_t>(at), kLocalBytes);
  if (!local || little(*local, 0, 4) != 0x04034b50U) return {};
  const std::uint64_t names = little(*local, 26, 2) + little(*local, 28, 2);
  if (is_inside(file, at, kLocalBytes + names + std::min(little(entry, 20, 4), unpacked))) return {};
  return damaged_zip();
}

// Aravis trusts the directory, and reads at its offsets, beyond the file too.
Status check_unpacked(const ReadMemory& read, const File& file) {
  const auto end = end_of(read, file);
  if (!end) return {};
  const std::uint32_t entries = end->bytes.size() < kEndBytes ? UINT32_MAX : little(end->bytes, 10, 2);
  if (entries > kMostEntries) return damaged_zip();
  std::int64_t at = end->at - little(end->bytes, 12, 4);
  const std::int64_t start = at - little(end->bytes, 16, 4);
  for (std::uint32_t i = 0; i < entries; ++i) {
    if (!is_inside(file, at, kEntryBytes)) return damaged_zip();
    const auto entry = read_some(read, file.address + static_cast<std::uint64_t>(at), kEntryBytes);
    if (!entry || little(*entry, 0, 4) != 0x02014b50U) return {};
    const std::uint32_t name = little(*entry, 28, 2);
    if (!is_inside(file, at, kEntryBytes + name)) return damaged_zip();
    RETURN_IF_ERROR(check_entry(read, file, start, *entry));
    at += kEntryBytes + name + little(*entry, 30, 2) + little(*entry, 32, 2);
  }
  return {};
}

constexpr int kMostDeep = 100;
constexpr double kMostSteps = 1e5;
constexpr long long kMostRegisterBytes = 1 << 16;
constexpr std::size_t kMostFormulaBytes = 1 << 13;  // Aravis takes kilobytes of memory for each byte of one

// References of a node that its value is computed from. Those for limits, access and selected features are evaluated
// separately, and do lead back to the node.
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

// To evaluate a value.
struct Effort {
  double steps = 1.0;
  int deep = 0;  // values taken one within the other
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
  // As deep as the document, which its parser limits. `owners`: the named nodes that `node` is part of.
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

  // Nothing: the evaluation has no end, or takes too many steps. `within`: values that are taken from this one.
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
  std::map<std::string, Effort> efforts_;                       // of those that have an end
  std::string bad_length_;                                      // whose it is
  std::string long_formula_;                                    // the same
};

}  // namespace

Status check_description_file(const ReadMemory& read) {
  checked_places.clear();
  for (const std::uint32_t place : {0x200U, 0x400U}) {
    const auto text = read_some(read, place, kUrlBytes);
    if (!text) continue;
    std::string url(text->begin(), std::ranges::find(*text, 0));
    checked_places.push_back(url);
    std::ranges::transform(url, url.begin(), [](unsigned char c) { return c >= 'A' && c <= 'Z' ? c + 32 : c; });
    const auto file = file_of(url);
    if (file && file->bytes > kMostBytes) {
      return too_large("its GenICam description is said to have " + std::to_string(file->bytes) + " bytes");
    }
    RETURN_IF_ERROR(check_place(url, file));
    if (!file) continue;
    if (file->zip) RETURN_IF_ERROR(check_unpacked(read, *file));
  }
  return {};
}

Status check_description(ArvGc* description) {
  return description != nullptr ? Description(description).check() : Status{};  // without one nothing is evaluated
}

}  // namespace bolo::genicam

// In place of Aravis's own function, which it calls with what a camera then says of where its description is: of this
// computer's files, too, and of any length.
extern "C" gboolean arv_parse_genicam_url(const char* url, gssize length, char** scheme, char** authority, char** path,
                                          char** query, char** fragment, guint64* address, guint64* size) {
  static const auto original = reinterpret_cast<decltype(&arv_parse_genicam_url)>(dlsym(RTLD_NEXT, __func__));
  if (std::ranges::find(bolo::genicam::checked_places, url) == bolo::genicam::checked_places.end()) return FALSE;
  return original(url, length, scheme, authority, path, query, fragment, address, size);
}
