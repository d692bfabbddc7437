// The POSIX shared memory object behind a name: who may create it, and when an old one is in the way.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::shm {

// "/bolo.NAME" for a name of 1 to 200 letters, digits, '-', '_', '.'; bad input otherwise. Thread: any.
Result<std::string> object_path(const std::string& name);

// Names of the objects that exist now, sorted, whether their writer lives or not; files whose name is none for shared
// memory are left out. Thread: any.
std::vector<std::string> object_names();

// True if this user's objects are trusted: anybody may make a file of any name in /dev/shm. Trusted are
// root, this process's own user, "bolo", which the packaged daemon runs as, and the user that the environment's
// BOLO_USER names or numbers. Thread: any.
std::vector<uid_t> believed_users();
bool is_believed(uid_t owner);
// "user alice (uid 1000)". Thread: any.
std::string user_words(uid_t user);

// An object that this process created and owns, mapped, and the lock of its name; both are unlinked in the destructor.
class OwnedObject {
 public:
  // Creates "/bolo." + name with `bytes` of zeroed memory that is really there. An object that a dead or stopped writer
  // of this user left is unlinked first; a living writer is refused as bad input. What other users have made under the
  // name can't be removed, but may go: that is a failure which says who they are. Only the owner can open the object
  // before publish_to(). Thread: setup.
  static Result<OwnedObject> create(const std::string& name, std::size_t bytes);

  OwnedObject() = default;
  OwnedObject(OwnedObject&& other) noexcept;
  OwnedObject& operator=(OwnedObject&& other) noexcept;
  ~OwnedObject();

  std::byte* data() const noexcept { return data_; }

  // Lets readers in: permission bits and, unless empty, the owner group. Thread: setup.
  Status publish_to(unsigned mode, const std::string& group);

 private:
  std::string path_;
  std::string lock_path_;
  UniqueFd object_;
  UniqueFd lock_;
  std::byte* data_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace bolo::shm
