// A gyro's samples from shared memory that anybody may have written (include/bolo/gyro_shm.h).
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

// Reads by pread(): anything that a writer does to the object, even making it shorter, ends as a short read. Samples
// that are no rates are skipped; where times go back, earlier samples are dropped.
class ShmGyro final : public Gyro {
 public:
  // Bad input: no such name. The object need not be there yet. Thread: setup.
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
  std::uint64_t next_ = 0;  // sample that is read next
  std::int64_t sampled_ns_ = 0;
  std::int64_t opened_ns_ = 0;  // tried to
  std::array<bolo_gyro_sample, 256> chunk_{};
  std::vector<GyroSample> kept_;
};

}  // namespace bolo::shm
