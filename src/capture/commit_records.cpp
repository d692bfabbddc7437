#include "src/capture/commit_records.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

#include <zlib.h>

#include "src/core/input_file.hpp"

namespace bolo::capture {
namespace {

constexpr std::uint64_t kMagic = 0x314c4e4a4f4c4f42ULL;            // "BOLOJNL1"
constexpr std::uint64_t kMostPages = std::uint64_t{1} << 18;       // 1 GiB: far beyond the changes of one commit
constexpr std::uint64_t kLastPage = (std::uint64_t{1} << 50) - 1;  // keeps offsets below 2^62

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

struct Records {
  PageRecord journal;
  PageRecord live;  // sequence 0: not valid
};

UniqueFd open_to_read(const std::filesystem::path& file) {
  return UniqueFd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
}

// Sequence number of the disk since the computer was booted.
std::string number_of_disk(dev_t device) {
  const std::string block = "/sys/dev/block/" + std::to_string(major(device)) + ":" + std::to_string(minor(device));
  const std::string whole = first_line(block + "/diskseq");
  return whole.empty() ? first_line(block + "/../diskseq") : whole;  // a partition has that of its disk
}

PageRecord read_live(const std::filesystem::path& file) {
  const UniqueFd live = open_to_read(live_of(file));
  PageRecord newest;
  if (!live) return newest;
  const CacheName cache = cache_of(live.get());
  if (cache.front() == '\0') return newest;
  for (const std::uint64_t at : {std::uint64_t{0}, kLivePointerStep}) {
    LivePointer pointer;
    if (!read_all(live.get(), at, sizeof pointer, &pointer)) continue;
    if (pointer.magic != LivePointer{}.magic || pointer.cache != cache) continue;
    auto record = read_record(live.get(), pointer.offset);
    if (record && record->sequence > newest.sequence) newest = std::move(*record);
  }
  return newest;
}

// The records lie beside the file itself, not beside a link to it.
std::filesystem::path real_name(const std::filesystem::path& file) {
  std::error_code error;
  std::filesystem::path real = std::filesystem::canonical(file, error);
  return error ? file : real;
}

// A live record older than the journal's lacks later writes to the file, and is ignored.
Records read_both(const std::filesystem::path& name) {
  const std::filesystem::path file = real_name(name);
  Records records;
  if (const UniqueFd journal = open_to_read(journal_of(file))) {
    records.journal = read_record(journal.get(), 0).value_or(PageRecord{});
  }
  records.live = read_live(file);
  if (records.live.sequence < records.journal.sequence) records.live = {};
  return records;
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

std::filesystem::path journal_of(const std::filesystem::path& file) { return file.string() + ".journal"; }
std::filesystem::path live_of(const std::filesystem::path& file) { return file.string() + ".live"; }

bool has_one_name(const std::filesystem::path& file) {
  struct stat there {};
  return ::lstat(file.c_str(), &there) != 0 || (S_ISREG(there.st_mode) && there.st_nlink == 1);
}

CacheName cache_of(int descriptor) {
  CacheName name{};
  struct stat info {};
  const std::string boot = first_line("/proc/sys/kernel/random/boot_id");
  if (boot.empty() || ::fstat(descriptor, &info) != 0) return name;
  const std::string text = boot + " " + number_of_disk(info.st_dev);
  std::copy_n(text.begin(), std::min(text.size(), name.size()), name.begin());
  return name;
}

LiveRecord::LiveRecord(UniqueFd file) : file_(std::move(file)), cache_(cache_of(file_.get())) {}

Result<LiveRecord> LiveRecord::create(const std::filesystem::path& file) {
  UniqueFd live(::open(live_of(file).c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0666));
  if (!live) return failed(std::strerror(errno));
  return LiveRecord(std::move(live));
}

void LiveRecord::write(const PageRecord& record) {
  if (!file_) return;
  const std::vector<std::byte> bytes = to_bytes(record);
  const std::uint64_t offset = begin_ - kPageBytes >= bytes.size() ? kPageBytes : end_;
  const LivePointer pointer{.offset = offset, .cache = cache_};
  if (write_all(file_.get(), offset, bytes.size(), bytes.data()) &&
      write_all(file_.get(), turn_ * kLivePointerStep, sizeof pointer, &pointer)) {
    turn_ = 1 - turn_;
    begin_ = offset;
    end_ = offset + bytes.size();
  } else if (::ftruncate(file_.get(), 0) == 0) {
    begin_ = end_ = kPageBytes;
  }
}

Pages read_records(const std::filesystem::path& file) {
  Records records = read_both(file);
  records.live.pages.merge(records.journal.pages);  // the live one's if both have a page
  return std::move(records.live.pages);
}

// The journal must be on disk before the file follows it, because a kill may have come before that. The live record
// does not survive a power cut, so it goes through the journal too, once the journal's own pages are in the file.
bool apply_records(const std::filesystem::path& file) {
  constexpr std::uint64_t kNoEnd = std::numeric_limits<std::uint64_t>::max();
  const UniqueFd to(::open(file.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW));
  if (!to) return false;
  if (::flock(to.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
  const UniqueFd journal(::open(journal_of(file).c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW));
  if (!journal && errno != ENOENT) return false;
  const Records records = read_both(file);
  if (journal && ::fsync(journal.get()) != 0) return false;
  if (!write_pages(to.get(), records.journal.pages, kNoEnd) || ::fsync(to.get()) != 0) return false;
  if (records.live.pages.empty()) return true;
  const std::vector<std::byte> bytes = to_bytes(records.live);
  if (journal && (!write_all(journal.get(), 0, bytes.size(), bytes.data()) || ::fsync(journal.get()) != 0))
    return false;
  return write_pages(to.get(), records.live.pages, kNoEnd) && ::fsync(to.get()) == 0;
}

void remove_records(const std::filesystem::path& file) {
  std::error_code ignored;
  std::filesystem::remove(journal_of(file), ignored);
  std::filesystem::remove(live_of(file), ignored);
}

}  // namespace bolo::capture
