#include "src/capture/disk_reserve.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace bolo::capture {
namespace {

constexpr std::uint64_t kSlack = std::uint64_t{1} << 20;
constexpr std::uint64_t kStep = std::uint64_t{8} << 20;  // asked for at once, to ask seldom

tl::unexpected<Error> no_room(int error) {
  return failed(std::string("no room to write: ") + std::strerror(error) + "; free some space or record elsewhere");
}

// The limit of `ulimit -f` doesn't bind fallocate() beyond the file's end, but it will bind the write.
bool within_size_limit(std::uint64_t end) {
  rlimit limit{};
  return getrlimit(RLIMIT_FSIZE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY || end <= limit.rlim_cur;
}

// 0 or an errno. File systems that cannot reserve (NFS, FAT) are asked for their free space instead.
int allocate(int descriptor, std::uint64_t begin, std::uint64_t end) {
  const auto offset = static_cast<off_t>(begin);
  const auto length = static_cast<off_t>(end - begin);
  int result = 0;
  do {
    result = fallocate(descriptor, FALLOC_FL_KEEP_SIZE, offset, length) == 0 ? 0 : errno;
  } while (result == EINTR);
  if (result != EOPNOTSUPP && result != ENOSYS) return result;
  struct statvfs space {};
  if (fstatvfs(descriptor, &space) != 0) return 0;
  return space.f_bavail * space.f_frsize < end - begin ? ENOSPC : 0;
}

}  // namespace

Result<DiskReserve> DiskReserve::open(const std::filesystem::path& file) {
  UniqueFd descriptor(::open(file.c_str(), O_WRONLY | O_CLOEXEC));
  if (!descriptor) return failed(std::string("cannot be opened: ") + std::strerror(errno));
  return DiskReserve(std::move(descriptor));
}

Status DiskReserve::ensure(std::uint64_t end) {
  end += kSlack;
  if (end <= reserved_) return {};
  if (!within_size_limit(end)) return no_room(EFBIG);
  // A full step first; near the end of the disk or of the size limit, just what is needed.
  int error = ENOSPC;
  if (within_size_limit(end + kStep)) error = allocate(file_.get(), reserved_, end + kStep);
  if (error == 0) {
    reserved_ = end + kStep;
    return {};
  }
  error = allocate(file_.get(), reserved_, end);
  if (error != 0) return no_room(error);
  reserved_ = end;
  return {};
}

void DiskReserve::release() noexcept {
  struct stat info {};
  if (fstat(file_.get(), &info) != 0) return;
  // Truncating to the size it has frees the blocks beyond; if it fails they stay reserved, which harms nothing.
  if (ftruncate(file_.get(), info.st_size) == 0) reserved_ = 0;
}

bool DiskReserve::sync() noexcept { return fsync(file_.get()) == 0; }

}  // namespace bolo::capture
