#include "drivers/genicam/description_file.hpp"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <string>
#include <string_view>

namespace bolo::genicam {
namespace {

using Bytes = std::vector<unsigned char>;

constexpr std::uint32_t kUrlBytes = 512;
constexpr std::uint32_t kReadBytes = 512;
constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20U;  // descriptions have 0.1 to 5 MB
constexpr std::uint32_t kEndBytes = 22;                         // of a ZIP file, without its comment
constexpr std::uint32_t kMostComment = 65535;
constexpr std::uint32_t kEntryBytes = 46;  // without its name
constexpr std::uint32_t kMostEntries = 64;

std::uint32_t little(const Bytes& bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8U | bytes[at + i];
  return value;
}

// `bytes` from `address` on, wherever that is.
std::optional<Bytes> read_some(const ReadMemory& read, std::uint64_t address, std::uint64_t bytes) {
  const std::uint64_t before = address % 4;
  Bytes out;
  for (std::uint64_t at = address - before; at < address + bytes; at += kReadBytes) {
    const auto count = std::min<std::uint64_t>(kReadBytes, (address + bytes - at + 3) / 4 * 4);
    const auto part = at + count <= UINT32_MAX ? read(static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(count))
                                               : std::nullopt;
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

// Of "Local:NAME;ADDRESS;SIZE", both hexadecimal; nothing for files elsewhere.
std::optional<File> file_of(std::string url) {
  std::ranges::transform(url, url.begin(), [](unsigned char c) { return c >= 'A' && c <= 'Z' ? c + 32 : c; });
  const std::size_t first = url.find(';');
  const std::size_t second = first == std::string::npos ? first : url.find(';', first + 1);
  if (!url.starts_with("local:") || second == std::string::npos) return std::nullopt;
  // What is negative or beyond 64 bits becomes the largest number.
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

// Where the directory's end is told of; nothing when there is none.
std::optional<Bytes> end_of(const ReadMemory& read, const File& file) {
  for (const std::uint64_t reach : {std::uint64_t{kReadBytes}, std::uint64_t{kEndBytes + kMostComment}}) {
    const std::uint64_t bytes = std::min(file.bytes, reach);
    const auto more = read_some(read, file.address + file.bytes - bytes, bytes);
    if (!more) return std::nullopt;
    constexpr std::string_view kSignature = "PK\x05\x06";
    const auto found = std::find_end(more->begin(), more->end(), kSignature.begin(), kSignature.end());
    if (std::distance(found, more->end()) >= std::ptrdiff_t{kEndBytes}) return Bytes(found, found + kEndBytes);
    if (bytes == file.bytes) break;
  }
  return std::nullopt;
}

Status check_unpacked(const ReadMemory& read, const File& file) {
  const auto end = end_of(read, file);
  if (!end) return {};
  std::uint64_t at = little(*end, 16, 4);
  const std::uint32_t entries = std::min(little(*end, 10, 2), kMostEntries);
  for (std::uint32_t i = 0; i < entries && at + kEntryBytes <= file.bytes; ++i) {
    const auto entry = read_some(read, file.address + at, kEntryBytes);
    if (!entry || little(*entry, 0, 4) != 0x02014b50U) return {};
    const std::uint32_t unpacked = little(*entry, 24, 4);
    if (unpacked > kMostBytes)
      return too_large("its GenICam description unpacks to " + std::to_string(unpacked) + " bytes");
    at += std::uint64_t{kEntryBytes} + little(*entry, 28, 2) + little(*entry, 30, 2) + little(*entry, 32, 2);
  }
  return {};
}

}  // namespace

Status check_description_file(const ReadMemory& read) {
  for (const std::uint32_t place : {0x200U, 0x400U}) {
    const auto text = read_some(read, place, kUrlBytes);
    const auto file = text ? file_of(std::string(text->begin(), std::ranges::find(*text, 0))) : std::nullopt;
    if (!file) continue;
    if (file->bytes > kMostBytes) {
      return too_large("its GenICam description is said to have " + std::to_string(file->bytes) + " bytes");
    }
    if (file->zip) RETURN_IF_ERROR(check_unpacked(read, *file));
  }
  return {};
}

}  // namespace bolo::genicam
