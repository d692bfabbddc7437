#include "src/capture/commit_records.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>

namespace bolo::capture {
namespace {

struct Records {
  PageRecord journal;
  PageRecord live;  // its sequence is 0 when it doesn't count
};

UniqueFd open_to_read(const std::filesystem::path& file) {
  return UniqueFd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
}

std::string first_line(const std::string& file) {
  std::string line;
  std::ifstream in(file);
  std::getline(in, line);
  return line;
}

// Counts the disks that were put in since the computer was started.
std::string number_of_disk(dev_t device) {
  const std::string block = "/sys/dev/block/" + std::to_string(major(device)) + ":" + std::to_string(minor(device));
  const std::string whole = first_line(block + "/diskseq");
  return whole.empty() ? first_line(block + "/../diskseq") : whole;  // that of the disk of a partition
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

// A live record that is older than the journal's knows nothing of what has been written to the file since.
Records read_both(const std::filesystem::path& file) {
  Records records;
  if (const UniqueFd journal = open_to_read(journal_of(file))) {
    records.journal = read_record(journal.get(), 0).value_or(PageRecord{});
  }
  records.live = read_live(file);
  if (records.live.sequence < records.journal.sequence) records.live = {};
  return records;
}

}  // namespace

std::filesystem::path journal_of(const std::filesystem::path& file) { return file.string() + ".journal"; }
std::filesystem::path live_of(const std::filesystem::path& file) { return file.string() + ".live"; }

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
  UniqueFd live(::open(live_of(file).c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
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
  records.live.pages.merge(records.journal.pages);  // the live one's where both have a page
  return std::move(records.live.pages);
}

// The journal must be on the disk before the file follows it: a kill may have come before that. The live
// record doesn't survive a cut of power, so it goes through the journal too, when the pages that this had are in the
// file.
bool apply_records(const std::filesystem::path& file) {
  constexpr std::uint64_t kNoEnd = std::numeric_limits<std::uint64_t>::max();
  const UniqueFd to(::open(file.c_str(), O_RDWR | O_CLOEXEC));
  if (!to) return false;
  if (::flock(to.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
  const UniqueFd journal(::open(journal_of(file).c_str(), O_RDWR | O_CLOEXEC));
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
