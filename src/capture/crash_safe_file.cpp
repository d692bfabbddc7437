#include "src/capture/crash_safe_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <exception>
#include <new>
#include <string>

namespace bolo::capture {
namespace {

// 16 MiB: beyond that a commit waits for the disk.
constexpr std::size_t kMostWaitingPages = std::size_t{1} << 12;

tl::unexpected<Error> not_opened(const char* what) {
  return bad_input(std::string("cannot be ") + what + ": " + std::strerror(errno));
}

constexpr const char* kIsBeingWritten = "is being written by another program; choose another name";

bool held_by_another(int descriptor) { return ::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK; }

Status check_only_name(const std::filesystem::path& file) {
  if (has_one_name(file)) return {};
  return bad_input("cannot be begun: " + file.filename().string() +
                   " is a link, has another name too, or is no file; remove it, or choose another name");
}

// A link is not followed: opening a device may already do something.
tl::unexpected<Error> is_there(const std::filesystem::path& file) {
  if (Status only = check_only_name(file); !only) return tl::unexpected(std::move(only.error()));
  const UniqueFd there(::open(file.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (there && held_by_another(there.get())) return bad_input(kIsBeingWritten);
  std::error_code ignored;
  if (std::filesystem::file_size(file, ignored) == 0)
    return bad_input("is there, and empty; remove it, or --overwrite it");
  return bad_input("is there: an unfinished recording; save it with bolo recover, or --overwrite it");
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

Status check_only_names(const std::filesystem::path& file, Replace replace) {
  if (replace == Replace::kExisting) RETURN_IF_ERROR(check_only_name(file));
  RETURN_IF_ERROR(check_only_name(journal_of(file)));
  return check_only_name(live_of(file));
}

// As has_one_name(), for the opened file: the name may belong to another file since it was checked. False with errno.
bool opened_only_name(const UniqueFd& file, struct stat& info) {
  if (!file || ::fstat(file.get(), &info) != 0) return false;
  if (S_ISREG(info.st_mode) && info.st_nlink <= 1) return true;
  errno = EMLINK;
  return false;
}

// A record of an earlier file must not be applied to this one, not even after a power cut.
UniqueFd create_journal(const std::filesystem::path& file, bool power) {
  UniqueFd journal(::open(journal_of(file).c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666));
  struct stat info {};
  if (!opened_only_name(journal, info)) return {};
  if (info.st_size == 0) return journal;
  const bool emptied = ::ftruncate(journal.get(), 0) == 0 && (!power || ::fsync(journal.get()) == 0);
  return emptied ? std::move(journal) : UniqueFd{};
}

constexpr std::uint64_t kReserveSlack = std::uint64_t{1} << 20;
constexpr std::uint64_t kReserveStep = std::uint64_t{8} << 20;  // reserved at once, to ask seldom

tl::unexpected<Error> no_room(int error) {
  return failed(std::string("no room to write: ") + std::strerror(error) + "; free some space or record elsewhere");
}

// fallocate() beyond the file's end ignores the limit of `ulimit -f`; the write will not.
bool within_size_limit(std::uint64_t end) {
  rlimit limit{};
  return getrlimit(RLIMIT_FSIZE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY || end <= limit.rlim_cur;
}

// 0 or an errno. File systems that cannot reserve (NFS, FAT) are asked for their free space instead.
int allocate(int descriptor, std::uint64_t begin, std::uint64_t end) {
  const auto offset = static_cast<off_t>(begin);
  const auto length = static_cast<off_t>(end - begin);
  int result = 0;
  do {
    result = fallocate(descriptor, FALLOC_FL_KEEP_SIZE, offset, length) == 0 ? 0 : errno;
  } while (result == EINTR);
  if (result != EOPNOTSUPP && result != ENOSYS) return result;
  struct statvfs space {};
  if (fstatvfs(descriptor, &space) != 0) return 0;
  return space.f_bavail * space.f_frsize < end - begin ? ENOSPC : 0;
}

// If there is no room for the record, the pages are written unprotected: frames are worth more.
bool write_journal(int journal, const PageRecord& record, bool power) {
  const std::vector<std::byte> bytes = to_bytes(record);
  const bool written = write_all(journal, 0, bytes.size(), bytes.data());  // C2
  if (written && (!power || ::fdatasync(journal) == 0)) return true;       // C3
  return (errno == ENOSPC || errno == EDQUOT || errno == EFBIG) && ::ftruncate(journal, 0) == 0;
}

// False if the lock's previous holder gave the file its final name. An error if a network file system does not answer.
Result<bool> still_named(int descriptor, const std::filesystem::path& file) {
  struct stat opened {};
  struct stat named {};
  if (::fstat(descriptor, &opened) != 0) return not_opened("created");
  if (::stat(file.c_str(), &named) != 0 && errno != ENOENT) return not_opened("created");
  return opened.st_dev == named.st_dev && opened.st_ino == named.st_ino;
}

}  // namespace

Status check_unfinished(const std::filesystem::path& file) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::symlink_status(file, ignored)) ? is_there(file) : Status{};
}

// A file that another writer holds is not touched. The records are emptied before the file.
Result<std::unique_ptr<CrashSafeFile>> CrashSafeFile::create(const std::filesystem::path& file, SurvivesCut survives,
                                                             Replace replace) {
  RETURN_IF_ERROR(check_only_names(file, replace));
  const int exclusive = replace == Replace::kNothing ? O_EXCL : 0;
  UniqueFd descriptor(::open(file.c_str(), O_RDWR | O_CREAT | exclusive | O_CLOEXEC | O_NOFOLLOW, 0666));
  if (!descriptor) return errno == EEXIST ? is_there(file) : not_opened("created");
  std::unique_ptr<CrashSafeFile> made(new CrashSafeFile(file, std::move(descriptor)));
  if (held_by_another(made->descriptor())) return bad_input(kIsBeingWritten);
  const Result<bool> ours = still_named(made->descriptor(), file);
  if (ours && !*ours) return bad_input(kIsBeingWritten);
  if (Status begun = ours ? made->begin(survives) : tl::unexpected(ours.error()); !begun) {
    if (replace == Replace::kNothing) {  // created here; it would be taken for an unfinished recording
      remove_records(file);
      ::unlink(file.c_str());
    }
    return tl::unexpected(std::move(begun.error()));
  }
  return made;
}

Status CrashSafeFile::begin(SurvivesCut survives) {
  struct stat info {};
  if (!opened_only_name(file_, info)) return not_opened("created");
  power_ = survives == SurvivesCut::kPower;
  journal_ = create_journal(name_, power_);
  if (!journal_) return not_opened("created with its journal");
  std::error_code ignored;
  std::filesystem::remove(live_of(name_), ignored);
  if (power_) {
    Result<LiveRecord> live = LiveRecord::create(name_);
    if (!live) return bad_input("cannot be created with its live record: " + live.error().message);
    live_ = std::move(*live);
  }
  if (!resize(0)) return not_opened("emptied");
  return {};
}

Result<std::unique_ptr<CrashSafeFile>> CrashSafeFile::open(const std::filesystem::path& file) {
  UniqueFd descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!descriptor) return not_opened("opened");
  std::unique_ptr<CrashSafeFile> made(new CrashSafeFile(file, std::move(descriptor)));
  struct stat info {};
  if (::fstat(made->descriptor(), &info) != 0) return not_opened("opened");
  made->waiting_ = read_records(file);
  made->size_ = made->opened_bytes_ = static_cast<std::uint64_t>(info.st_size);
  return made;
}

Status CrashSafeFile::reserve(std::uint64_t end) {
  end += kReserveSlack;
  if (end <= reserved_) return {};
  if (!within_size_limit(end)) return no_room(EFBIG);
  // A full step first; near the end of the disk or of the size limit, only what is needed.
  std::uint64_t to = end + kReserveStep;
  int error = within_size_limit(to) ? allocate(file_.get(), reserved_, to) : ENOSPC;
  if (error != 0) {
    to = end;
    error = allocate(file_.get(), reserved_, to);
  }
  if (error != 0) return no_room(error);
  reserved_ = to;
  return {};
}

// The newest version of a page: waiting, then on its way to the disk. Null: as in the file.
const Page* CrashSafeFile::in_memory(std::uint64_t number) const {
  if (const auto page = waiting_.find(number); page != waiting_.end()) return &page->second;
  const auto page = on_way_.pages.find(number);
  return page != on_way_.pages.end() ? &page->second : nullptr;
}

bool CrashSafeFile::read(std::uint64_t offset, std::size_t bytes, void* out) const {
  auto* to = static_cast<std::byte*>(out);
  const ssize_t done = read_some(file_.get(), offset, bytes, to);
  if (done < 0) return false;
  if (static_cast<std::size_t>(done) < bytes && offset + static_cast<std::uint64_t>(done) < opened_bytes_) {
    errno = EIO;
    return false;
  }
  std::memset(to + done, 0, bytes - static_cast<std::size_t>(done));
  return for_each_page(offset, bytes, [&](std::uint64_t number, std::size_t inside, std::size_t count, std::size_t at) {
    if (const Page* page = in_memory(number)) std::memcpy(to + at, page->data() + inside, count);
    return true;
  });
}

bool CrashSafeFile::write(std::uint64_t offset, std::size_t bytes, const void* data) {
  const auto* from = static_cast<const std::byte*>(data);
  const std::uint64_t committed = committed_pages_ * kPageBytes;
  const std::size_t held = offset >= committed ? 0 : std::min<std::uint64_t>(bytes, committed - offset);
  if (held > 0 && !defer_write(offset, held, from)) return false;
  if (bytes > held && !write_through(offset + held, bytes - held, from + held)) return false;
  size_ = std::max(size_, offset + bytes);
  return true;
}

bool CrashSafeFile::write_through(std::uint64_t offset, std::size_t bytes, const std::byte* data) {
  if (!write_all(file_.get(), offset, bytes, data)) return false;
  length_ = std::max(length_, offset + bytes);
  return true;
}

bool CrashSafeFile::defer_write(std::uint64_t offset, std::size_t bytes, const std::byte* data) {
  return for_each_page(offset, bytes, [&](std::uint64_t number, std::size_t inside, std::size_t count, std::size_t at) {
    auto page = waiting_.find(number);
    if (page == waiting_.end()) {
      Page before(kPageBytes);
      if (const Page* known = in_memory(number)) {
        before = *known;
      } else if (read_some(file_.get(), number * kPageBytes, kPageBytes, before.data()) < 0) {
        return false;
      }
      page = waiting_.emplace(number, std::move(before)).first;
    }
    std::memcpy(page->second.data() + inside, data + at, count);
    return true;
  });
}

bool CrashSafeFile::commit(std::uint64_t end) {
  end_ = end;
  size_ = std::max(size_, end);
  if (size_ > length_ && !resize(size_)) return false;  // waiting pages may reach beyond it
  ++sequence_;
  if (!(power_ ? commit_for_power() : commit_here())) return false;
  committed_pages_ = (size_ + kPageBytes - 1) / kPageBytes;
  return true;
}

// C1 to C4; without syncs if only the process may die. 0, or an errno; then it can be called again. Thread: the disk's
// while it is under way, otherwise the writer's.
int CrashSafeFile::write_commit(const PageRecord& record, std::uint64_t end) try {
  if (power_) {
    names_durable_ = names_durable_ || sync_folder_of(name_);
    if (!names_durable_ || ::fdatasync(file_.get()) != 0) return errno;  // C1
  }
  if (record.pages.empty()) return 0;
  if (!write_journal(journal_.get(), record, power_)) return errno;  // C2, C3
  return write_pages(file_.get(), record.pages, end) ? 0 : errno;    // C4
} catch (const std::bad_alloc&) {
  return ENOMEM;
}

bool CrashSafeFile::commit_here() {
  PageRecord record{sequence_, std::move(waiting_)};
  const int error = write_commit(record, size_);
  waiting_.clear();
  if (error == 0) return true;
  waiting_ = std::move(record.pages);
  errno = error;
  return false;
}

bool CrashSafeFile::commit_for_power() {
  const bool too_much = waiting_.size() > kMostWaitingPages;
  const bool ended = disk_.valid() && disk_.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  if (disk_.valid() && (too_much || ended) && !end_disk()) return false;
  PageRecord record{sequence_, waiting_};
  record.pages.insert(on_way_.pages.begin(), on_way_.pages.end());  // keeps waiting versions
  live_.write(record);                                              // P
  if (!disk_.valid()) begin_disk();
  return true;
}

// If no thread can be started, the pages wait for the next commit.
void CrashSafeFile::begin_disk() {
  on_way_ = {sequence_, std::move(waiting_)};
  waiting_.clear();
  try {
    disk_ = std::async(std::launch::async, [this, end = size_] { return write_commit(on_way_, end); });
  } catch (const std::exception&) {  // for lack of memory or threads
    waiting_.swap(on_way_.pages);
  }
}

// Waits for the commit on its way to the disk. If it failed, its pages wait again, except those with a newer version.
bool CrashSafeFile::end_disk() {
  const int error = disk_.get();
  if (error != 0) waiting_.merge(on_way_.pages);
  on_way_.pages.clear();
  errno = error;
  return error == 0;
}

// A file system that cannot be asked at present (NFS) proves nothing.
bool CrashSafeFile::is_ours() const {
  struct stat opened {};
  struct stat named {};
  if (::fstat(file_.get(), &opened) != 0) return true;
  if (::stat(name_.c_str(), &named) != 0) return errno != ENOENT && errno != ENOTDIR;
  return opened.st_dev == named.st_dev && opened.st_ino == named.st_ino &&
         static_cast<std::uint64_t>(opened.st_size) >= length_;
}

// Truncating to the file's own size frees the space reserved beyond it.
bool CrashSafeFile::finish() {
  if (disk_.valid() && !end_disk()) return false;
  ++sequence_;
  if (!waiting_.empty() && !commit_here()) return false;
  return resize(end_) && ::fsync(file_.get()) == 0;
}

bool CrashSafeFile::resize(std::uint64_t end) {
  if (::ftruncate(file_.get(), static_cast<off_t>(end)) != 0) return false;
  size_ = length_ = end;
  return true;
}

}  // namespace bolo::capture
