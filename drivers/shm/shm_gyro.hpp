// Gyro samples from shared memory, which any program may have written (include/bolo/gyro_shm.h).
#pragma once

#include <sys/types.h>

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "bolo/gyro_shm.h"
#include "src/core/gyro.hpp"
#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::shm {

// Reads with pread(), so that even a truncated object only causes a short read. Invalid rates are skipped; when times
// go backwards, earlier samples are dropped.
class ShmGyro final : public Gyro {
 public:
  // Bad input: an invalid name. The object need not exist yet. Thread: setup.
  static Result<std::unique_ptr<Gyro>> create(const std::string& name);

  std::span<const GyroSample> samples() noexcept override;
  std::int64_t time_of(const FrameMeta& frame) const noexcept override { return host_time_ns(frame); }

 private:
  explicit ShmGyro(std::string path);
  void open(std::int64_t now_ns) noexcept;
  bool read(void* to, std::size_t bytes, std::uint64_t from) const noexcept;
  bool read_new() noexcept;
  void take(const bolo_gyro_sample& sample) noexcept;

  std::string path_;
  std::vector<uid_t> trusted_;
  UniqueFd object_;
  ino_t inode_ = 0;
  std::uint64_t next_ = 0;  // next sample to read
  std::int64_t sampled_ns_ = 0;
  std::int64_t opened_ns_ = 0;  // last attempt
  std::array<bolo_gyro_sample, 256> chunk_{};
  std::vector<GyroSample> kept_;
};

}  // namespace bolo::shm
