#include "drivers/shm/shm_object.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <grp.h>
#include <pwd.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include "bolo/shm_layout.h"
#include "drivers/shm/shared_words.hpp"
#include "src/core/input_file.hpp"
#include "src/core/text.hpp"

namespace bolo::shm {
namespace {

struct Range {
  std::atomic<std::byte*> data{nullptr};  // stored last, cleared first
  std::atomic<std::size_t> bytes{0};
  std::atomic<int> protection{0};
};

constexpr std::size_t kMost = 64;
std::array<Range, kMost> ranges;

std::mutex changes;  // guards ranges and the members below
std::size_t mappings = 0;
struct sigaction before {};  // read by the handler: set before it is installed

bool lies_in(const Range& range, const void* address) noexcept {
  const std::byte* const data = range.data.load(std::memory_order_acquire);  // partner: GuardedMapping
  const auto from = reinterpret_cast<std::uintptr_t>(data);
  const auto at = reinterpret_cast<std::uintptr_t>(address);
  return data != nullptr && at >= from && at - from < range.bytes.load(std::memory_order_relaxed);
}

// Async-signal-safe.
bool put_zeros(const Range& range) noexcept {
  void* const data = range.data.load(std::memory_order_relaxed);
  const std::size_t bytes = range.bytes.load(std::memory_order_relaxed);
  const int protection = range.protection.load(std::memory_order_relaxed);
  return mmap(data, bytes, protection, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0) != MAP_FAILED;
}

void pass_to_previous(int signal, siginfo_t* info, void* context) {
  if ((before.sa_flags & SA_SIGINFO) != 0) return before.sa_sigaction(signal, info, context);
  if (before.sa_handler != SIG_DFL && before.sa_handler != SIG_IGN) return before.sa_handler(signal);
  ::signal(signal, SIG_DFL);
  raise(signal);  // delivered after the handler has returned
}

void on_bus_error(int signal, siginfo_t* info, void* context) {
  const int error = errno;
  for (const Range& range : ranges) {
    if (info->si_code > 0 && lies_in(range, info->si_addr) && put_zeros(range)) {
      errno = error;
      return;
    }
  }
  pass_to_previous(signal, info, context);
}

void catch_bus_errors() noexcept {
  struct sigaction ours {};
  ours.sa_sigaction = on_bus_error;
  ours.sa_flags = SA_SIGINFO | SA_RESTART | SA_ONSTACK;
  sigaction(SIGBUS, nullptr, &before);
  sigaction(SIGBUS, &ours, nullptr);
}

// The library may be unloaded. A handler installed after ours is kept.
void restore_handler() noexcept {
  struct sigaction now {};
  if (sigaction(SIGBUS, nullptr, &now) == 0 && now.sa_sigaction == on_bus_error) sigaction(SIGBUS, &before, nullptr);
}

}  // namespace

GuardedMapping::GuardedMapping(void* data, std::size_t bytes, int protection) noexcept
    : data_(static_cast<std::byte*>(data)), bytes_(bytes), place_(0) {
  const std::lock_guard lock(changes);
  if (mappings++ == 0) catch_bus_errors();
  while (place_ < kMost && ranges[place_].data.load(std::memory_order_relaxed) != nullptr) ++place_;
  if (place_ == kMost) return;
  ranges[place_].bytes.store(bytes, std::memory_order_relaxed);
  ranges[place_].protection.store(protection, std::memory_order_relaxed);
  ranges[place_].data.store(data_, std::memory_order_release);  // partner: lies_in()
}

// Clears its entry first: the addresses may be reused immediately.
GuardedMapping::~GuardedMapping() {
  const std::lock_guard lock(changes);
  if (place_ < kMost) ranges[place_].data.store(nullptr, std::memory_order_relaxed);
  munmap(data_, bytes_);
  if (--mappings == 0) restore_handler();
}

namespace {

constexpr std::string_view kPrefix = "bolo.";
constexpr std::string_view kLockPrefix = "bolo-lock.";  // not a stream's
constexpr const char* kFolder = "/dev/shm";
constexpr const char* kPackagedUser = "bolo";
constexpr std::size_t kMaxName = 200;
constexpr int kClaimAttempts = 20;

std::string errno_text(int error) { return std::strerror(error); }

bool valid_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
}

bool valid_name(std::string_view name) {
  return !name.empty() && name.size() <= kMaxName && std::all_of(name.begin(), name.end(), valid_character);
}

std::optional<uid_t> uid_of(const std::string& user) {
  uid_t number = 0;
  const char* const end = user.data() + user.size();
  if (const auto [rest, error] = std::from_chars(user.data(), end, number); error == std::errc() && rest == end) {
    return number;
  }
  std::vector<char> buffer(16384);
  struct passwd entry {};
  struct passwd* found = nullptr;
  getpwnam_r(user.c_str(), &entry, buffer.data(), buffer.size(), &found);
  return found != nullptr ? std::optional<uid_t>(found->pw_uid) : std::nullopt;
}

// True while the name refers to the open file; the link count cannot tell, as the file may be renamed or mounted over.
bool is_at(const UniqueFd& fd, const std::string& path) noexcept {
  std::array<char, 256> place{};  // no allocation: also called while the writer ends
  std::snprintf(place.data(), place.size(), "%s%s", kFolder, path.c_str());
  struct stat ours {};
  struct stat there {};
  return fd && fstat(fd.get(), &ours) == 0 && lstat(place.data(), &there) == 0 && ours.st_dev == there.st_dev &&
         ours.st_ino == there.st_ino;
}

// An object's header; nothing when it has none or cannot be read.
std::optional<bolo_shm_header> read_header(const std::string& path) {
  const UniqueFd fd(shm_open(path.c_str(), O_RDONLY | O_NONBLOCK, 0));  // anybody can put a pipe there
  bolo_shm_header header{};
  const ssize_t got = fd ? pread(fd.get(), &header, sizeof(header), 0) : -1;
  if (got != static_cast<ssize_t>(sizeof(header)) || header.magic != BOLO_SHM_MAGIC) return std::nullopt;
  return header;
}

// ", process 123 (bolod)": the writer named in the object, if that user has such a process.
std::string describe_process(const std::string& path, uid_t owner) {
  const auto header = read_header(path);
  const std::string process = header ? "/proc/" + std::to_string(header->writer_pid) : "";
  struct stat status {};
  if (!header || stat(process.c_str(), &status) != 0 || status.st_uid != owner) return "";
  return ", process " + std::to_string(header->writer_pid) + " (" + printable(first_line(process + "/comm")) + ")";
}

tl::unexpected<Error> living(const std::string& path, const std::optional<bolo_shm_header>& header) {
  if (!header) {
    return bad_input("shared memory " + path +
                     " is being set up by another process; try again, or choose another name");
  }
  return bad_input("shared memory " + path + " is written by process " + std::to_string(header->writer_pid) +
                   "; stop it, or choose another name");
}

tl::unexpected<Error> in_the_way(const std::string& file, const std::string& object, int error) {
  const std::string place = kFolder + file;
  struct stat status {};
  const bool there = lstat(place.c_str(), &status) == 0;
  if (there && !S_ISREG(status.st_mode) && status.st_uid == geteuid()) {
    return failed(place + " is in the way: it is no shared memory; remove it, or choose another name");
  }
  if (!there || status.st_uid == geteuid()) {
    return failed("cannot create shared memory " + file + ": " + errno_text(error));
  }
  return failed(place + " is in the way: it belongs to " + describe_user(status.st_uid) +
                describe_process(object, status.st_uid) +
                "; have them end what made it, remove it as root, or choose " + "another name");
}

// A writer in another time namespace (container) has another clock: check that its heartbeat changes, not its age.
bool still_beats(const std::string& object, std::uint64_t heartbeat_ns) {
  constexpr std::chrono::milliseconds kTwoBeats(500);
  std::this_thread::sleep_for(kTwoBeats);
  const auto header = read_header(object);
  return header && header->heartbeat_ns != heartbeat_ns;
}

// One attempt to become the only writer of the name: the locked descriptor, or an empty one to retry.
//
// The lock is a separate file, because anybody who can open a file can lock it, and readers open the object. The kernel
// drops it when the holder dies. A lock file without its name lost it between open and flock: retry. A stalled writer
// keeps its lock, so its lock file is unlinked and replaced.
Result<UniqueFd> try_lock(const std::string& lock, const std::string& object) {
  UniqueFd fd(shm_open(lock.c_str(), O_RDWR | O_CREAT, 0600));
  struct stat status {};
  if (!fd || fstat(fd.get(), &status) != 0) return in_the_way(lock, object, errno);
  if (status.st_uid != geteuid()) return in_the_way(lock, object, EACCES);
  const bool locked = flock(fd.get(), LOCK_EX | LOCK_NB) == 0;
  if (!is_at(fd, lock)) return UniqueFd();
  if (locked) return fd;
  const auto header = read_header(object);
  if (!header || !heartbeat_stale(header->heartbeat_ns) || still_beats(object, header->heartbeat_ns)) {
    return living(object, header);
  }
  shm_unlink(lock.c_str());
  return UniqueFd();
}

Result<UniqueFd> lock_name(const std::string& lock, const std::string& object) {
  for (int attempt = 0; attempt < kClaimAttempts; ++attempt) {
    Result<UniqueFd> fd = try_lock(lock, object);
    if (!fd || *fd) return fd;
  }
  return failed("shared memory " + lock + " is unlinked and made anew by others all the time; choose another name");
}

// Creates an empty object in place of the last writer's.
Result<UniqueFd> make_object(const std::string& path) {
  for (int attempt = 0; attempt < kClaimAttempts; ++attempt) {
    UniqueFd fd(shm_open(path.c_str(), O_RDWR | O_CREAT | O_EXCL, 0600));
    if (fd) return fd;
    if (errno != EEXIST) return in_the_way(path, path, errno);
    if (shm_unlink(path.c_str()) != 0 && errno != ENOENT) return in_the_way(path, path, errno);
  }
  return failed("shared memory " + path + " is made by others all the time; choose another name");
}

// Allocates all pages now: with a full /dev/shm the first access would otherwise raise SIGBUS.
Status reserve(int fd, const std::string& path, std::size_t bytes) {
  int error = 0;
  do {
    error = posix_fallocate(fd, 0, static_cast<off_t>(bytes));
  } while (error == EINTR);
  if (error == 0) return {};
  const std::string mebibytes = std::to_string((bytes + (1U << 20) - 1) >> 20);
  if (error == ENOSPC || error == EFBIG || error == ENOMEM) {
    return bad_input("/dev/shm has no room for the " + mebibytes + " MiB of " + path +
                     "; free some, lower shm.slots, or enlarge it (mount -o remount,size=... /dev/shm)");
  }
  return failed("cannot take " + mebibytes + " MiB for " + path + ": " + errno_text(error));
}

Result<gid_t> group_id(const std::string& group) {
  std::vector<char> buffer(16384);
  struct group entry {};
  struct group* found = nullptr;
  const int error = getgrnam_r(group.c_str(), &entry, buffer.data(), buffer.size(), &found);
  if (error == 0 && found != nullptr) return found->gr_gid;
  return bad_input("no group '" + group + "' for the shared memory; create it (groupadd) or set shm.group");
}

}  // namespace

Result<std::string> object_path(const std::string& name) {
  if (!valid_name(name)) {
    return bad_input("'" + printable(name.substr(0, 80)) + "' is no name for shared memory; use 1 to " +
                     std::to_string(kMaxName) + " letters, digits, '-', '_', '.'");
  }
  return "/" + std::string(kPrefix) + name;
}

std::vector<std::string> object_names() {
  std::vector<std::string> names;
  DIR* folder = opendir(kFolder);
  if (folder == nullptr) return names;
  while (const dirent* entry = readdir(folder)) {
    const std::string_view file = entry->d_name;
    if (!file.starts_with(kPrefix)) continue;
    if (const std::string_view name = file.substr(kPrefix.size()); valid_name(name)) names.emplace_back(name);
  }
  closedir(folder);
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<uid_t> trusted_users() {
  std::vector<uid_t> users{0, geteuid()};
  const char* const named = std::getenv("BOLO_USER");  // NOLINT(concurrency-mt-unsafe): nothing here sets it
  for (const char* const user : {kPackagedUser, named != nullptr ? named : ""}) {
    if (const auto uid = *user != '\0' ? uid_of(user) : std::nullopt) users.push_back(*uid);
  }
  return users;
}

bool is_trusted(uid_t owner) {
  const std::vector<uid_t> users = trusted_users();
  return std::ranges::find(users, owner) != users.end();
}

std::string describe_user(uid_t user) {
  std::vector<char> buffer(16384);
  struct passwd entry {};
  struct passwd* found = nullptr;
  getpwuid_r(user, &entry, buffer.data(), buffer.size(), &found);
  const std::string number = std::to_string(user);
  return found != nullptr ? "user " + printable(found->pw_name) + " (uid " + number + ")" : "user " + number;
}

Result<OwnedObject> OwnedObject::create(const std::string& name, std::size_t bytes) {
  OwnedObject object;
  ASSIGN_OR_RETURN(object.path_, object_path(name));
  object.lock_path_ = "/" + std::string(kLockPrefix) + name;
  ASSIGN_OR_RETURN(object.lock_, lock_name(object.lock_path_, object.path_));
  RETURN_IF_ERROR(object.make(bytes));
  return object;
}

Result<OwnedObject> OwnedObject::create_again() {
  OwnedObject object;
  object.path_ = path_;
  object.lock_path_ = lock_path_;
  if (is_at(lock_, lock_path_)) object.lock_ = std::move(lock_);
  if (!object.lock_) {
    ASSIGN_OR_RETURN(object.lock_, lock_name(lock_path_, path_));
  }
  RETURN_IF_ERROR(object.make(memory_->bytes()));
  return object;
}

Status OwnedObject::make(std::size_t bytes) {
  ASSIGN_OR_RETURN(object_, make_object(path_));
  RETURN_IF_ERROR(reserve(object_.get(), path_, bytes));
  void* memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, object_.get(), 0);
  if (memory == MAP_FAILED) return failed("cannot map shared memory " + path_ + ": " + errno_text(errno));
  memory_ = std::make_unique<GuardedMapping>(memory, bytes, PROT_READ | PROT_WRITE);
  return {};
}

bool OwnedObject::is_there() const noexcept {
  struct stat status {};
  return is_at(lock_, lock_path_) && is_at(object_, path_) && fstat(object_.get(), &status) == 0 &&
         status.st_size >= static_cast<off_t>(memory_->bytes());
}

OwnedObject::OwnedObject(OwnedObject&& other) noexcept { *this = std::move(other); }

OwnedObject& OwnedObject::operator=(OwnedObject&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(lock_path_, other.lock_path_);
  std::swap(object_, other.object_);
  std::swap(lock_, other.lock_);
  std::swap(memory_, other.memory_);
  return *this;
}

// A successor that considered this writer dead may have the names by now: do not unlink those.
OwnedObject::~OwnedObject() {
  const auto unlink_ours = [](const UniqueFd& fd, const std::string& path) {
    if (is_at(fd, path)) shm_unlink(path.c_str());
  };
  unlink_ours(object_, path_);
  unlink_ours(lock_, lock_path_);
}

Status OwnedObject::publish_to(unsigned mode, const std::string& group) {
  if (!group.empty()) {
    ASSIGN_OR_RETURN(const gid_t gid, group_id(group));
    if (fchown(object_.get(), static_cast<uid_t>(-1), gid) != 0) {
      return bad_input("cannot give shared memory " + path_ + " to group '" + group + "': " + errno_text(errno) +
                       "; make the daemon's user a member of it (adduser USER " + group + ") and start it again");
    }
  }
  if (fchmod(object_.get(), static_cast<mode_t>(mode)) != 0) {
    return bad_input("cannot set the mode of shared memory " + path_ + ": " + errno_text(errno));
  }
  return {};
}

}  // namespace bolo::shm
