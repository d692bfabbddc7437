// The POSIX shared memory object behind a name: who may create it, and when an old one is in the way.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::shm {

// Accessing mapped memory after its owner truncated it, or when its file system is full, raises SIGBUS; no prior check
// can exclude that. A guarded mapping is then replaced by private zeros: a reader sees a writer that has ended, and a
// writer detects that its object was truncated. SIGBUS elsewhere goes to the previous handler. Only the first 64
// mappings are guarded. Thread: any.
class GuardedMapping {
 public:
  // Takes ownership of `data`, from mmap() with this protection.
  GuardedMapping(void* data, std::size_t bytes, int protection) noexcept;
  ~GuardedMapping();
  GuardedMapping(const GuardedMapping&) = delete;
  GuardedMapping& operator=(const GuardedMapping&) = delete;

  std::byte* data() const noexcept { return data_; }
  std::size_t bytes() const noexcept { return bytes_; }

 private:
  std::byte* data_;
  std::size_t bytes_;
  std::size_t place_;
};

// --- POSIX shared memory objects by name: who may create them, and when an old one is in the way.

// "/bolo.NAME" for a name of 1 to 200 letters, digits, '-', '_', '.'; bad input otherwise. Thread: any.
Result<std::string> object_path(const std::string& name);

// Sorted names of all existing objects, their writers alive or not; omits invalid names. Thread: any.
std::vector<std::string> object_names();

// Trusted owners: root, this process's user, "bolo" (the packaged daemon's user), and the user in the environment
// variable BOLO_USER (name or number). Needed because anybody can create a file of any name in /dev/shm. Thread: any.
std::vector<uid_t> trusted_users();
bool is_trusted(uid_t owner);
std::string describe_user(uid_t user);

// An object created, owned and mapped by this process, and its name's lock; the destructor unlinks both.
class OwnedObject {
 public:
  // Creates "/bolo." + name with `bytes` of zeroed, allocated memory. Unlinks an object left by a dead or stopped
  // writer of this user; a live writer is bad input. Objects of other users cannot be removed: kFailed, naming the
  // user. Only the owner can open the object before publish_to(). Thread: setup.
  static Result<OwnedObject> create(const std::string& name, std::size_t bytes);

  // Recreates the object when is_there() no longer holds, under the same lock if that still exists; this one stays
  // mapped without a name. Errors: see create(). Thread: any, one at a time.
  Result<OwnedObject> create_again();

  OwnedObject() = default;
  OwnedObject(OwnedObject&& other) noexcept;
  OwnedObject& operator=(OwnedObject&& other) noexcept;
  ~OwnedObject();

  std::byte* data() const noexcept { return memory_ ? memory_->data() : nullptr; }
  // False once a name was removed (/dev/shm cleanup) or the object truncated: new data is invisible then. Thread: any.
  bool is_there() const noexcept;

  // Grants access to readers: permission bits and, unless empty, the owner group. Thread: setup.
  Status publish_to(unsigned mode, const std::string& group);

 private:
  Status make(std::size_t bytes);

  std::string path_;
  std::string lock_path_;
  UniqueFd object_;
  UniqueFd lock_;
  std::unique_ptr<GuardedMapping> memory_;
};

}  // namespace bolo::shm
