#include "drivers/shm/shm_object.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <grp.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <utility>

#include "bolo/shm_layout.h"
#include "drivers/shm/shared_words.hpp"

namespace bolo::shm {
namespace {

constexpr std::string_view kPrefix = "bolo.";
constexpr std::size_t kMaxName = 200;
constexpr int kClaimAttempts = 20;

std::string errno_text(int error) { return std::strerror(error); }

bool valid_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
}

// What can be said of an object whose lock another process holds.
enum class Holder { kLiving, kStarting, kStopped };

struct HolderState {
  Holder holder = Holder::kStarting;
  std::uint32_t pid = 0;
};

HolderState inspect(int fd) {
  bolo_shm_header header{};
  const ssize_t got = pread(fd, &header, sizeof(header), 0);
  if (got != static_cast<ssize_t>(sizeof(header)) || header.magic != BOLO_SHM_MAGIC) return {Holder::kStarting, 0};
  return {heartbeat_stale(header.heartbeat_ns) ? Holder::kStopped : Holder::kLiving, header.writer_pid};
}

Error taken(const std::string& path, const HolderState& state) {
  if (state.holder == Holder::kStarting) {
    return {ErrorKind::kBadInput,
            "shared memory " + path + " is being set up by another process; try again, or choose " + "another name"};
  }
  return {ErrorKind::kBadInput, "shared memory " + path + " is written by process " + std::to_string(state.pid) +
                                    "; stop it, or choose another name"};
}

Error cannot_open(const std::string& path, int error) {
  if (error == EACCES || error == EPERM) {
    return {ErrorKind::kBadInput,
            "shared memory " + path + " belongs to another user; run as that user, or remove " + "/dev/shm" + path};
  }
  return {ErrorKind::kFailed, "cannot create shared memory " + path + ": " + errno_text(error)};
}

// One try to become the owner of the name. Returns the locked descriptor of an empty object, or -1 to try again.
//
// The kernel drops the lock when its holder dies, so a lock that can be had is a dead writer's (size > 0) or a new
// object (size 0); an object whose last link is gone was unlinked between open and lock.
Result<int> try_claim(const std::string& path) {
  const int fd = shm_open(path.c_str(), O_RDWR | O_CREAT, 0600);
  if (fd < 0) return tl::unexpected<Error>(cannot_open(path, errno));
  const bool locked = flock(fd, LOCK_EX | LOCK_NB) == 0;
  struct stat status {};
  const bool linked = fstat(fd, &status) == 0 && status.st_nlink > 0;
  if (locked && linked && status.st_size == 0) return fd;
  const HolderState state = locked ? HolderState{Holder::kStopped, 0} : inspect(fd);
  if (linked && state.holder == Holder::kStopped) shm_unlink(path.c_str());
  close(fd);
  if (linked && state.holder != Holder::kStopped) return tl::unexpected<Error>(taken(path, state));
  return -1;
}

Result<int> claim(const std::string& path) {
  for (int attempt = 0; attempt < kClaimAttempts; ++attempt) {
    Result<int> fd = try_claim(path);
    if (!fd || *fd >= 0) return fd;
  }
  return failed("shared memory " + path + " is unlinked and made anew by others all the time; choose another name");
}

// All pages are taken now: a full /dev/shm would otherwise kill the writer with SIGBUS at its first touch.
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
  if (name.empty() || name.size() > kMaxName || !std::all_of(name.begin(), name.end(), valid_character)) {
    return bad_input("'" + name.substr(0, 80) + "' is no name for shared memory; use 1 to " + std::to_string(kMaxName) +
                     " letters, digits, '-', '_', '.'");
  }
  return "/" + std::string(kPrefix) + name;
}

std::vector<std::string> object_names() {
  std::vector<std::string> names;
  DIR* folder = opendir("/dev/shm");
  if (folder == nullptr) return names;
  while (const dirent* entry = readdir(folder)) {
    const std::string_view file = entry->d_name;
    if (file.starts_with(kPrefix) && file.size() > kPrefix.size()) names.emplace_back(file.substr(kPrefix.size()));
  }
  closedir(folder);
  std::sort(names.begin(), names.end());
  return names;
}

Result<OwnedObject> OwnedObject::create(const std::string& name, std::size_t bytes) {
  const Result<std::string> path = object_path(name);
  if (!path) return tl::unexpected<Error>(path.error());
  const Result<int> fd = claim(*path);
  if (!fd) return tl::unexpected<Error>(fd.error());
  OwnedObject object;
  object.path_ = *path;
  object.fd_ = *fd;
  if (const Status status = reserve(*fd, *path, bytes); !status) return tl::unexpected<Error>(status.error());
  void* memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, *fd, 0);
  if (memory == MAP_FAILED) return failed("cannot map shared memory " + *path + ": " + errno_text(errno));
  object.data_ = static_cast<std::byte*>(memory);
  object.bytes_ = bytes;
  return object;
}

OwnedObject::OwnedObject(OwnedObject&& other) noexcept { *this = std::move(other); }

OwnedObject& OwnedObject::operator=(OwnedObject&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(fd_, other.fd_);
  std::swap(data_, other.data_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

OwnedObject::~OwnedObject() {
  if (data_ != nullptr) munmap(data_, bytes_);
  if (fd_ < 0) return;
  // A successor that thought this writer dead has the name by now: then it is not ours to unlink.
  struct stat status {};
  if (fstat(fd_, &status) == 0 && status.st_nlink > 0) shm_unlink(path_.c_str());
  close(fd_);
}

Status OwnedObject::publish_to(unsigned mode, const std::string& group) {
  if (!group.empty()) {
    const Result<gid_t> gid = group_id(group);
    if (!gid) return tl::unexpected<Error>(gid.error());
    if (fchown(fd_, static_cast<uid_t>(-1), *gid) != 0) {
      return bad_input("cannot give shared memory " + path_ + " to group '" + group + "': " + errno_text(errno) +
                       "; the daemon's user must be a member of it");
    }
  }
  if (fchmod(fd_, static_cast<mode_t>(mode)) != 0) {
    return bad_input("cannot set the mode of shared memory " + path_ + ": " + errno_text(errno));
  }
  return {};
}

}  // namespace bolo::shm
