// A camera's memory with the file of its GenICam description: a line says where that is, the file follows.
#include "drivers/genicam/description.hpp"
#include "tests/fuzz/input.hpp"

namespace {

constexpr std::uint32_t kText = 0x200;
constexpr std::uint32_t kTextBytes = 512;
constexpr std::uint32_t kFile = 0x10000;

// Aravis takes the last two numbers of the text.
bool leads_beyond_any(std::string text) {
  text.resize(std::min(text.find_first_of("?#"), text.size()));
  const std::size_t second = text.rfind(';');
  const std::size_t first =
      second == std::string::npos || second == 0 ? std::string::npos : text.rfind(';', second - 1);
  if (first == std::string::npos) return false;
  const std::uint64_t address = std::strtoull(text.c_str() + first + 1, nullptr, 16);
  const std::uint64_t bytes = std::strtoull(text.c_str() + second + 1, nullptr, 16);
  return bytes > 64U << 20U || address > UINT32_MAX || address + bytes > std::uint64_t{UINT32_MAX} + 1;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const std::string_view all(reinterpret_cast<const char*>(data), bytes);
  const std::size_t end = std::min(all.find('\n'), all.size());
  const std::string text(all.substr(0, std::min<std::size_t>(end, kTextBytes)));
  const std::string_view file = all.substr(std::min(end + 1, all.size()));
  const auto read = [&](std::uint32_t address, std::uint32_t count) {
    std::vector<unsigned char> part(count);
    const bool is_text = address >= kText && address < kText + kTextBytes;
    const std::string_view there = is_text ? text : file;
    const std::size_t begin = address - (is_text ? kText : kFile);  // before the file: beyond its end
    if (begin < there.size()) std::ranges::copy(there.substr(begin, count), part.begin());
    return std::optional(part);
  };
  const bolo::Status taken = bolo::genicam::check_description_file(read);
  const std::string shown = text.substr(0, text.find('\0'));
  if (taken && (shown.starts_with("Local:") || shown.starts_with("local:")) && leads_beyond_any(shown)) std::abort();
  return 0;
}
