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

// Mapped memory whose owner makes it shorter, or whose file system has no page left for it, ends a process that
// accesses it (SIGBUS), and no check before is in time. A guarded mapping turns into zeros of the process's own
// instead: to a reader of shared memory that is a writer which has ended, and a writer finds that its object was cut.
// Signals elsewhere go where they went before the first of these. Of more mappings than a process should have, the last
// are not guarded. Thread: any.
class GuardedMapping {
 public:
  // Comes to own `data`: of mmap(), with this protection.
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

// --- The POSIX shared memory object behind a name: who may create it, and when an old one is in the way.

// "/bolo.NAME" for a name of 1 to 200 letters, digits, '-', '_', '.'; bad input otherwise. Thread: any.
Result<std::string> object_path(const std::string& name);

// Names of the objects that exist now, sorted, whether their writer lives or not; files whose name is none for shared
// memory are left out. Thread: any.
std::vector<std::string> object_names();

// True if this user's objects are trusted: anybody may make a file of any name in /dev/shm. Trusted are
// root, this process's own user, "bolo", which the packaged daemon runs as, and the user that the environment's
// BOLO_USER names or numbers. Thread: any.
std::vector<uid_t> trusted_users();
bool is_trusted(uid_t owner);
// "user alice (uid 1000)". Thread: any.
std::string describe_user(uid_t user);

// An object that this process created and owns, mapped, and the lock of its name; both are unlinked in the destructor.
class OwnedObject {
 public:
  // Creates "/bolo." + name with `bytes` of zeroed memory that is really allocated. An object that a dead or stopped
  // writer of this user left is unlinked first; a living writer is refused as bad input. Objects of other users can't
  // be removed, but may go: that is a failure which names the user. Only the owner can open the object before
  // publish_to(). Thread: setup.
  static Result<OwnedObject> create(const std::string& name, std::size_t bytes);

  // Another like this one where is_there() no longer holds, under the same lock if that is there; this one stays
  // mapped, without a name. Errors: create()'s. Thread: any, one at a time.
  Result<OwnedObject> create_again();

  OwnedObject() = default;
  OwnedObject(OwnedObject&& other) noexcept;
  OwnedObject& operator=(OwnedObject&& other) noexcept;
  ~OwnedObject();

  std::byte* data() const noexcept { return memory_ ? memory_->data() : nullptr; }
  // False once a name was taken away, as what cleans up /dev/shm does, or the object was cut: what is written goes
  // nowhere then. Thread: any.
  bool is_there() const noexcept;

  // Lets readers in: permission bits and, unless empty, the owner group. Thread: setup.
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
