#include "src/capture/crash_safe_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace bolo::capture {
namespace {

constexpr std::uint64_t kMagic = 0x314c4e4a4f4c4f42ULL;       // "BOLOJNL1"
constexpr std::uint64_t kMostPages = std::uint64_t{1} << 18;  // 1 GiB: far beyond what one commit changes
constexpr std::uint64_t kStartWritingAt = std::uint64_t{2} << 20;

// The record: this head, then the pages' numbers, then the pages.
struct Head {
  std::uint64_t magic = kMagic;
  std::uint64_t sequence = 0;
  std::uint64_t pages = 0;
  std::uint64_t checksum = 0;  // of sequence, numbers and pages
};

// FNV-1a over 64-bit words, with a rotation so that high bits reach low ones.
class Checksum {
 public:
  void add(std::uint64_t word) noexcept {
    value_ = (value_ ^ word) * 0x100000001b3ULL;
    value_ ^= value_ >> 29U;
  }
  void add(const Page& page) noexcept {
    for (std::size_t at = 0; at < page.size(); at += sizeof(std::uint64_t)) {
      std::uint64_t word = 0;
      std::memcpy(&word, page.data() + at, sizeof word);
      add(word);
    }
  }
  std::uint64_t value() const noexcept { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325ULL;
};

std::uint64_t checksum_of(std::uint64_t sequence, const Pages& pages) {
  Checksum sum;
  sum.add(sequence);
  for (const auto& [number, page] : pages) {
    sum.add(number);
    sum.add(page);
  }
  return sum.value();
}

bool write_all(int descriptor, std::uint64_t offset, std::size_t bytes, const std::byte* data) {
  while (bytes > 0) {
    const ssize_t done = ::pwrite(descriptor, data, bytes, static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    data += done;
    bytes -= static_cast<std::size_t>(done);
    offset += static_cast<std::uint64_t>(done);
  }
  return true;
}

// Fewer bytes than asked for only at the end of the file; -1 on failure.
ssize_t read_some(int descriptor, std::uint64_t offset, std::size_t bytes, std::byte* out) {
  std::size_t total = 0;
  while (total < bytes) {
    const ssize_t done = ::pread(descriptor, out + total, bytes - total, static_cast<off_t>(offset + total));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) return -1;
    if (done == 0) break;
    total += static_cast<std::size_t>(done);
  }
  return static_cast<ssize_t>(total);
}

bool read_all(int descriptor, std::uint64_t offset, std::size_t bytes, void* out) {
  return read_some(descriptor, offset, bytes, static_cast<std::byte*>(out)) == static_cast<ssize_t>(bytes);
}

}  // namespace

bool sync_folder_of(const std::filesystem::path& file) {
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool good = ::fsync(descriptor) == 0;
  ::close(descriptor);
  return good;
}

namespace {

Pages read_record(int descriptor) {
  Head head;
  struct stat info {};
  if (!read_all(descriptor, 0, sizeof head, &head) || head.magic != kMagic || ::fstat(descriptor, &info) != 0)
    return {};
  const std::uint64_t fits = static_cast<std::uint64_t>(info.st_size) / (kPageBytes + sizeof(std::uint64_t));
  if (head.pages > std::min(fits, kMostPages)) return {};
  std::vector<std::uint64_t> numbers(head.pages);
  const std::size_t number_bytes = numbers.size() * sizeof(std::uint64_t);
  if (!read_all(descriptor, sizeof head, number_bytes, numbers.data())) return {};
  Pages pages;
  std::uint64_t at = sizeof head + number_bytes;
  for (const std::uint64_t number : numbers) {
    Page page(kPageBytes);
    if (!read_all(descriptor, at, kPageBytes, page.data())) return {};
    pages.emplace(number, std::move(page));
    at += kPageBytes;
  }
  return checksum_of(head.sequence, pages) == head.checksum ? pages : Pages{};
}

tl::unexpected<Error> not_opened(const char* what) {
  return bad_input(std::string("cannot be ") + what + ": " + std::strerror(errno));
}

// Calls use(page number, offset inside it, bytes, place in the buffer) for each page that the range touches.
template <typename Use>
bool for_each_page(std::uint64_t offset, std::size_t bytes, Use use) {
  for (std::size_t done = 0; done < bytes;) {
    const std::uint64_t number = (offset + done) / kPageBytes;
    const std::size_t inside = (offset + done) % kPageBytes;
    const std::size_t count = std::min(bytes - done, kPageBytes - inside);
    if (!use(number, inside, count, done)) return false;
    done += count;
  }
  return true;
}

}  // namespace

std::filesystem::path journal_of(const std::filesystem::path& file) { return file.string() + ".journal"; }

Pages read_journal(const std::filesystem::path& file) {
  const int descriptor = ::open(journal_of(file).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return {};
  Pages pages = read_record(descriptor);
  ::close(descriptor);
  return pages;
}

bool settle(const std::filesystem::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) return false;
  bool good = ::flock(descriptor, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK;
  for (const auto& [number, page] : read_journal(file)) {
    good = good && write_all(descriptor, number * kPageBytes, kPageBytes, page.data());
  }
  good = good && ::fsync(descriptor) == 0;
  const int why = errno;
  ::close(descriptor);
  errno = why;
  return good;
}

// Nothing of a file that another writer holds is touched. The journal is emptied before the file is: a record of an
// earlier file must not be laid over this one.
Result<std::unique_ptr<CrashSafeFile>> CrashSafeFile::create(const std::filesystem::path& file, SurvivesCut survives) {
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor < 0) return not_opened("created");
  std::unique_ptr<CrashSafeFile> made(new CrashSafeFile(descriptor, -1, survives));
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    return bad_input("is being written by another program; choose another name");
  }
  made->journal_ = ::open(journal_of(file).c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (made->journal_ < 0) return not_opened("created with its journal");
  const bool power = survives == SurvivesCut::kPower;
  if (power && (::fsync(made->journal_) != 0 || !sync_folder_of(file))) return not_opened("created");
  if (!made->resize(0)) return not_opened("emptied");
  return made;
}

Result<std::unique_ptr<CrashSafeFile>> CrashSafeFile::open(const std::filesystem::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return not_opened("opened");
  std::unique_ptr<CrashSafeFile> made(new CrashSafeFile(descriptor, -1, SurvivesCut::kProcess));
  struct stat info {};
  if (::fstat(descriptor, &info) != 0) return not_opened("opened");
  made->waiting_ = read_journal(file);
  made->size_ = static_cast<std::uint64_t>(info.st_size);
  return made;
}

CrashSafeFile::~CrashSafeFile() {
  if (journal_ >= 0) ::close(journal_);
  if (file_ >= 0) ::close(file_);
}

bool CrashSafeFile::read(std::uint64_t offset, std::size_t bytes, void* out) const {
  auto* to = static_cast<std::byte*>(out);
  const ssize_t done = read_some(file_, offset, bytes, to);
  if (done < 0) return false;
  std::memset(to + done, 0, bytes - static_cast<std::size_t>(done));
  if (waiting_.empty()) return true;
  return for_each_page(offset, bytes, [&](std::uint64_t number, std::size_t inside, std::size_t count, std::size_t at) {
    const auto page = waiting_.find(number);
    if (page != waiting_.end()) std::memcpy(to + at, page->second.data() + inside, count);
    return true;
  });
}

bool CrashSafeFile::write(std::uint64_t offset, std::size_t bytes, const void* data) {
  const auto* from = static_cast<const std::byte*>(data);
  const std::uint64_t committed = committed_pages_ * kPageBytes;
  const std::size_t held = offset >= committed ? 0 : std::min<std::uint64_t>(bytes, committed - offset);
  if (held > 0 && !hold_back(offset, held, from)) return false;
  if (bytes > held && !write_through(offset + held, bytes - held, from + held)) return false;
  size_ = std::max(size_, offset + bytes);
  return true;
}

// The disk is set to work early, so that the next commit has little to wait for.
bool CrashSafeFile::write_through(std::uint64_t offset, std::size_t bytes, const std::byte* data) {
  if (!write_all(file_, offset, bytes, data)) return false;
  length_ = std::max(length_, offset + bytes);
  not_started_ += bytes;
  if (survives_ == SurvivesCut::kPower && not_started_ >= kStartWritingAt) {
    ::sync_file_range(file_, 0, 0, SYNC_FILE_RANGE_WRITE);
    not_started_ = 0;
  }
  return true;
}

bool CrashSafeFile::hold_back(std::uint64_t offset, std::size_t bytes, const std::byte* data) {
  return for_each_page(offset, bytes, [&](std::uint64_t number, std::size_t inside, std::size_t count, std::size_t at) {
    const auto [page, is_new] = waiting_.try_emplace(number, kPageBytes, std::byte{0});
    if (is_new && read_some(file_, number * kPageBytes, kPageBytes, page->second.data()) < 0) {
      waiting_.erase(page);
      return false;
    }
    std::memcpy(page->second.data() + inside, data + at, count);
    return true;
  });
}

bool CrashSafeFile::commit(std::uint64_t end) {
  size_ = std::max(size_, end);
  if (size_ > length_ && !resize(size_)) return false;  // pages that wait may reach beyond
  const bool power = survives_ == SurvivesCut::kPower;
  if (power && ::fdatasync(file_) != 0) return false;  // C1
  not_started_ = 0;
  if (!waiting_.empty() && (!write_journal() || !apply())) return false;
  committed_pages_ = (size_ + kPageBytes - 1) / kPageBytes;
  return true;
}

// Where there is no room for the record, frames are worth more than its protection: the pages are written without.
bool CrashSafeFile::write_journal() {
  std::vector<std::byte> record(sizeof(Head) + waiting_.size() * (sizeof(std::uint64_t) + kPageBytes));
  const Head head{kMagic, ++sequence_, waiting_.size(), checksum_of(sequence_, waiting_)};
  std::memcpy(record.data(), &head, sizeof head);
  std::byte* number_at = record.data() + sizeof head;
  std::byte* page_at = number_at + waiting_.size() * sizeof(std::uint64_t);
  for (const auto& [number, page] : waiting_) {
    std::memcpy(number_at, &number, sizeof number);
    std::memcpy(page_at, page.data(), kPageBytes);
    number_at += sizeof number;
    page_at += kPageBytes;
  }
  const bool written = write_all(journal_, 0, record.size(), record.data());                       // C2
  if (written && (survives_ == SurvivesCut::kProcess || ::fdatasync(journal_) == 0)) return true;  // C3
  return (errno == ENOSPC || errno == EDQUOT || errno == EFBIG) && ::ftruncate(journal_, 0) == 0;
}

bool CrashSafeFile::apply() {
  for (const auto& [number, page] : waiting_) {  // C4
    const std::uint64_t offset = number * kPageBytes;
    if (offset >= size_) continue;
    if (!write_all(file_, offset, std::min<std::uint64_t>(kPageBytes, size_ - offset), page.data())) return false;
  }
  waiting_.clear();
  return true;
}

bool CrashSafeFile::resize(std::uint64_t end) {
  if (::ftruncate(file_, static_cast<off_t>(end)) != 0) return false;
  size_ = length_ = end;
  return true;
}

}  // namespace bolo::capture
