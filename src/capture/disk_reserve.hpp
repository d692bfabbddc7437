// Room on the disk ahead of a growing file, so that "disk full" is learnt before a write fails half-way and leaves the
// file's structure torn.
#pragma once

#include <cstdint>
#include <filesystem>
#include <utility>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::capture {

class DiskReserve {
 public:
  // `file` exists already. Thread: any one at a time.
  static Result<DiskReserve> open(const std::filesystem::path& file);

  // The file may grow to `end` bytes, and by kSlack beyond for HDF5's own structures. Errors: kFailed with the cause
  // (disk full, quota, file size limit); what was reserved before stays.
  Status ensure(std::uint64_t end);

  // Gives back what lies beyond the file's end.
  void release() noexcept;

  // Makes the file durable. False on failure, errno tells why.
  bool sync() noexcept;

 private:
  explicit DiskReserve(UniqueFd file) : file_(std::move(file)) {}
  UniqueFd file_;
  std::uint64_t reserved_ = 0;
};

}  // namespace bolo::capture
