// Shared memory of a hostile writer, which keeps changing it while it is read.
#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "bolo/shm_layout.h"
#include "src/core/clock.hpp"
#include "src/core/unique_fd.hpp"
#include "tests/fuzz/input.hpp"

namespace bolo::fuzz {

// Next step of the reader or of the concurrent writer; the fields' meaning depends on the target.
struct Step {
  std::uint8_t what = 0;
  std::uint16_t where = 0;
  std::uint64_t value = 0;
};

inline std::vector<Step> take_steps(Input& input) {
  std::vector<Step> steps(input.take<std::uint8_t>() % 16);
  for (Step& step : steps) {
    step = {input.take<std::uint8_t>(), input.take<std::uint16_t>(), input.take<std::uint64_t>()};
  }
  return steps;
}

class HostileObject {
 public:
  static constexpr std::size_t kMostBytes = std::size_t{1} << 16;

  // Same size and content as `bytes`; the heartbeat is fresh.
  HostileObject(const std::string& name, std::span<const std::uint8_t> bytes) : path_("/bolo." + name) {
    bytes_ = std::min(bytes.size(), kMostBytes);
    const UniqueFd object(shm_open(path_.c_str(), O_RDWR | O_CREAT | O_TRUNC, 0600));
    if (!object || ftruncate(object.get(), static_cast<off_t>(bytes_)) != 0) std::abort();
    if (bytes_ == 0) return;
    void* memory = mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED, object.get(), 0);
    if (memory == MAP_FAILED) std::abort();
    data_ = static_cast<std::byte*>(memory);
    std::memcpy(data_, bytes.data(), bytes_);
    beat();
  }
  ~HostileObject() {
    if (data_ != nullptr) munmap(data_, bytes_);
    shm_unlink(path_.c_str());
  }
  HostileObject(const HostileObject&) = delete;
  HostileObject& operator=(const HostileObject&) = delete;

  void beat() { write(offsetof(bolo_shm_header, heartbeat_ns), monotonic_ns()); }

  // Changes 8 bytes; ignored outside of the object.
  template <typename T>
  void write(std::size_t offset, T value) {
    static_assert(sizeof value == 8);
    if (offset + sizeof value <= bytes_) std::memcpy(data_ + offset, &value, sizeof value);
  }

 private:
  std::string path_;
  std::byte* data_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace bolo::fuzz
