#include "src/capture/pages.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <zlib.h>

namespace bolo::capture {
namespace {

constexpr std::uint64_t kMagic = 0x314c4e4a4f4c4f42ULL;            // "BOLOJNL1"
constexpr std::uint64_t kMostPages = std::uint64_t{1} << 18;       // 1 GiB: far beyond what one commit changes
constexpr std::uint64_t kLastPage = (std::uint64_t{1} << 50) - 1;  // offsets stay below 2^62

struct Head {
  std::uint64_t magic = kMagic;
  std::uint64_t sequence = 0;
  std::uint64_t pages = 0;
  std::uint64_t checksum = 0;  // CRC-32 of sequence, numbers and pages
};

std::uint64_t checksum_of(const PageRecord& record) {
  uLong sum = crc32_z(0, nullptr, 0);
  const auto add = [&sum](const void* data, std::size_t bytes) {
    sum = crc32_z(sum, static_cast<const Bytef*>(data), bytes);
  };
  add(&record.sequence, sizeof record.sequence);
  for (const auto& [number, page] : record.pages) {
    add(&number, sizeof number);
    add(page.data(), page.size());
  }
  return sum;
}

}  // namespace

bool write_all(int descriptor, std::uint64_t offset, std::size_t bytes, const void* data) {
  const auto* from = static_cast<const std::byte*>(data);
  while (bytes > 0) {
    const ssize_t done = ::pwrite(descriptor, from, bytes, static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    from += done;
    bytes -= static_cast<std::size_t>(done);
    offset += static_cast<std::uint64_t>(done);
  }
  return true;
}

ssize_t read_some(int descriptor, std::uint64_t offset, std::size_t bytes, void* out) {
  auto* to = static_cast<std::byte*>(out);
  std::size_t total = 0;
  while (total < bytes) {
    const ssize_t done = ::pread(descriptor, to + total, bytes - total, static_cast<off_t>(offset + total));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) return -1;
    if (done == 0) break;
    total += static_cast<std::size_t>(done);
  }
  return static_cast<ssize_t>(total);
}

bool read_all(int descriptor, std::uint64_t offset, std::size_t bytes, void* out) {
  return read_some(descriptor, offset, bytes, out) == static_cast<ssize_t>(bytes);
}

bool write_pages(int descriptor, const Pages& pages, std::uint64_t end) {
  for (const auto& [number, page] : pages) {
    const std::uint64_t offset = number * kPageBytes;
    if (offset >= end) break;
    if (!write_all(descriptor, offset, std::min<std::uint64_t>(kPageBytes, end - offset), page.data())) return false;
  }
  return true;
}

std::vector<std::byte> to_bytes(const PageRecord& record) {
  const std::size_t count = record.pages.size();
  std::vector<std::byte> bytes(sizeof(Head) + count * (sizeof(std::uint64_t) + kPageBytes));
  const Head head{kMagic, record.sequence, count, checksum_of(record)};
  std::memcpy(bytes.data(), &head, sizeof head);
  std::byte* number_at = bytes.data() + sizeof head;
  std::byte* page_at = number_at + count * sizeof(std::uint64_t);
  for (const auto& [number, page] : record.pages) {
    std::memcpy(number_at, &number, sizeof number);
    std::memcpy(page_at, page.data(), kPageBytes);
    number_at += sizeof number;
    page_at += kPageBytes;
  }
  return bytes;
}

std::optional<PageRecord> read_record(int descriptor, std::uint64_t offset) {
  Head head;
  struct stat info {};
  if (!read_all(descriptor, offset, sizeof head, &head) || head.magic != kMagic || ::fstat(descriptor, &info) != 0) {
    return std::nullopt;
  }
  const std::uint64_t fits = static_cast<std::uint64_t>(info.st_size) / (kPageBytes + sizeof(std::uint64_t));
  if (head.pages > std::min(fits, kMostPages)) return std::nullopt;
  std::vector<std::uint64_t> numbers(head.pages);
  const std::size_t number_bytes = numbers.size() * sizeof(std::uint64_t);
  std::uint64_t at = offset + sizeof head;
  if (!read_all(descriptor, at, number_bytes, numbers.data())) return std::nullopt;
  at += number_bytes;
  PageRecord record{head.sequence, {}};
  for (const std::uint64_t number : numbers) {
    Page page(kPageBytes);
    if (number > kLastPage || !read_all(descriptor, at, kPageBytes, page.data())) return std::nullopt;
    record.pages.emplace(number, std::move(page));
    at += kPageBytes;
  }
  if (checksum_of(record) != head.checksum) return std::nullopt;
  return record;
}

}  // namespace bolo::capture
