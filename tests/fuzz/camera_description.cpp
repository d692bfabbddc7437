// A camera's memory with its GenICam description file: one line with the file's address, then the file.
#include "drivers/genicam/description.hpp"
#include "tests/fuzz/input.hpp"

namespace {

constexpr std::uint32_t kText = 0x200;
constexpr std::uint32_t kTextBytes = 512;
constexpr std::uint32_t kFile = 0x10000;

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
    const std::size_t begin = address - (is_text ? kText : kFile);  // addresses before the file wrap to beyond its end
    if (begin < there.size()) std::ranges::copy(there.substr(begin, count), part.begin());
    return std::optional(part);
  };
  // Either a description or an error of one line.
  const bolo::Status taken = bolo::genicam::take_description(read);
  if (!taken && (taken.error().message.empty() || taken.error().message.find('\n') != std::string::npos)) std::abort();
  return 0;
}
