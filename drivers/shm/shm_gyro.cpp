#include "drivers/shm/shm_gyro.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>

#include "drivers/shm/shm_object.hpp"
#include "src/core/clock.hpp"

namespace bolo::shm {
namespace {

constexpr std::size_t kMostKept = 16384;         // samples: a second at 111 ms per frame and 16 kHz
constexpr std::int64_t kSilentNs = 500'000'000;  // then the name may refer to another object
constexpr std::int64_t kLastTimeNs = std::int64_t{1} << 62;

}  // namespace

Result<std::unique_ptr<Gyro>> ShmGyro::create(const std::string& name) {
  RETURN_IF_ERROR(object_path(name));
  return std::unique_ptr<Gyro>(new ShmGyro("/dev/shm/bolo-gyro." + name));
}

ShmGyro::ShmGyro(std::string path) : path_(std::move(path)), trusted_(trusted_users()) { kept_.reserve(kMostKept); }

bool ShmGyro::read(void* to, std::size_t bytes, std::uint64_t from) const noexcept {
  return ::pread(object_.get(), to, bytes, static_cast<off_t>(from)) == static_cast<ssize_t>(bytes);
}

std::span<const GyroSample> ShmGyro::samples() noexcept {
  const std::int64_t now_ns = monotonic_ns();
  if (read_new()) {
    sampled_ns_ = now_ns;
  } else if (now_ns - std::max(sampled_ns_, opened_ns_) > kSilentNs) {
    open(now_ns);
  }
  return kept_;
}

// O_NONBLOCK: a pipe under this name must not block.
void ShmGyro::open(std::int64_t now_ns) noexcept {
  opened_ns_ = now_ns;
  UniqueFd object(::open(path_.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC | O_NOFOLLOW));
  struct stat status {};
  if (!object || fstat(object.get(), &status) != 0 || !S_ISREG(status.st_mode)) return;
  if (std::ranges::find(trusted_, status.st_uid) == trusted_.end()) return;
  if (object_ && status.st_ino == inode_) return;
  object_ = std::move(object);
  inode_ = status.st_ino;
  next_ = 0;
  kept_.clear();
}

// True when a sample was read. Skips samples that the writer may be overwriting.
bool ShmGyro::read_new() noexcept {
  bolo_gyro_header header{};
  if (!object_ || !read(&header, sizeof header, 0)) return false;
  const std::uint64_t capacity = header.capacity;
  if (header.magic != BOLO_GYRO_MAGIC || header.version != BOLO_GYRO_VERSION) return false;
  if (capacity < BOLO_GYRO_LEAST_CAPACITY || capacity > BOLO_GYRO_MOST_CAPACITY) return false;
  const std::uint64_t written = header.written;
  if (written == next_) return false;
  if (written < next_) kept_.clear();
  if (written - next_ > capacity / 2) next_ = written - std::min(written, capacity / 2);
  while (next_ != written) {
    const std::uint64_t place = next_ % capacity;
    const std::uint64_t count = std::min({std::uint64_t{chunk_.size()}, written - next_, capacity - place});
    if (!read(chunk_.data(), count * sizeof chunk_[0], sizeof header + place * sizeof chunk_[0])) return false;
    if (!read(&header.written, sizeof header.written, offsetof(bolo_gyro_header, written))) return false;
    for (std::uint64_t i = 0; i < count; ++i) {
      if (next_ + i + capacity > header.written) take(chunk_[i]);
    }
    next_ += count;
  }
  return true;
}

void ShmGyro::take(const bolo_gyro_sample& sample) noexcept {
  const GyroSample taken{sample.time_ns, {sample.rate[0], sample.rate[1], sample.rate[2]}};
  if (taken.time_ns < 0 || taken.time_ns > kLastTimeNs || !is_turn(taken.rate)) return;
  if (!kept_.empty() && taken.time_ns == kept_.back().time_ns) return;
  if (!kept_.empty() && taken.time_ns < kept_.back().time_ns) kept_.clear();
  if (kept_.size() == kMostKept) kept_.erase(kept_.begin(), kept_.begin() + kMostKept / 2);
  kept_.push_back(taken);
}

}  // namespace bolo::shm
