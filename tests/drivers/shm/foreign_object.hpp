// Shared memory not created by our sink.
#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "tests/test.hpp"

namespace bolo::shm {

class ForeignObject {
 public:
  explicit ForeignObject(std::string name) : name_(std::move(name)) {}
  ~ForeignObject() { shm_unlink(("/bolo." + name_).c_str()); }
  ForeignObject(const ForeignObject&) = delete;
  ForeignObject& operator=(const ForeignObject&) = delete;

  const std::string& name() const { return name_; }

  void fill(const void* data, std::size_t bytes, std::size_t total) const {
    shm_unlink(("/bolo." + name_).c_str());
    const int fd = shm_open(("/bolo." + name_).c_str(), O_RDWR | O_CREAT, 0600);
    ASSERT_GE(fd, 0);
    ASSERT_EQ(ftruncate(fd, static_cast<off_t>(total)), 0);
    ASSERT_EQ(pwrite(fd, data, std::min(bytes, total), 0), static_cast<ssize_t>(std::min(bytes, total)));
    close(fd);
  }
  void cut(std::size_t bytes) const {
    ASSERT_EQ(truncate(("/dev/shm/bolo." + name_).c_str(), static_cast<off_t>(bytes)), 0);
  }

 private:
  std::string name_;
};

}  // namespace bolo::shm
