// The POSIX shared memory object behind a name: who may create it, and when an old one is in the way.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::shm {

// "/bolo.NAME" for a name of 1 to 200 letters, digits, '-', '_', '.'; bad input otherwise. Thread: any.
Result<std::string> object_path(const std::string& name);

// Names of the objects that exist now, sorted, whether their writer lives or not. Thread: any.
std::vector<std::string> object_names();

// An object that this process created and owns: open, locked, mapped; unlinked in the destructor.
class OwnedObject {
 public:
  // Creates "/bolo." + name with `bytes` of zeroed memory that is really there. An object that a dead or stopped writer
  // left is unlinked first; a living writer is refused. Only the owner can open it before publish_to(). Thread: setup.
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
  int fd_ = -1;
  std::byte* data_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace bolo::shm
