#include "src/capture/open_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "src/core/unique_fd.hpp"

namespace bolo::capture {
namespace {

constexpr std::string_view kOldMatlab = "MATLAB 5.0 MAT-file";

// Readable and a regular file; fills `head` with the first bytes.
Status read_head(const std::filesystem::path& file, std::array<char, 128>& head) {
  const UniqueFd descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!descriptor) return bad_input(std::string("cannot be opened: ") + std::strerror(errno));
  struct stat info {};
  const bool regular = fstat(descriptor.get(), &info) == 0 && S_ISREG(info.st_mode);
  const bool has_bytes = regular && ::read(descriptor.get(), head.data(), head.size()) > 0;
  if (!regular) return bad_input("is not a regular file; expected a capture");
  if (!has_bytes) return bad_input("is empty; expected a capture");
  return {};
}

}  // namespace

h5::Handle file_access() {
  h5::Handle access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_file_locking(access.get(), true, true);
  return access;
}

Result<h5::Handle> open_hdf5(const std::filesystem::path& file, FileUse use) {
  std::array<char, 128> head{};
  if (Status good = read_head(file, head); !good) return tl::unexpected<Error>(std::move(good.error()));
  if (std::string_view(head.data(), kOldMatlab.size()) == kOldMatlab) {
    return bad_input("is a MATLAB file before version 7.3; save it again with save(..., '-v7.3')");
  }
  if (H5Fis_hdf5(file.c_str()) == 0) return bad_input("is not an HDF5 file; expected a capture (.h5 or .mat v7.3)");
  const h5::Handle access = file_access();
  if (!open_crash_safe(access.get(), use)) return bad_input("cannot be opened" + h5::because());
  h5::Handle handle(H5Fopen(file.c_str(), H5F_ACC_RDONLY, access.get()));
  if (handle) return handle;
  const std::string reason = h5::cause();
  if (reason.find("truncated") != std::string::npos) return bad_input("is cut off: " + reason);
  if (reason.find("lock") != std::string::npos) {
    return bad_input("is being written by another program; read it when that has ended (" + reason + ")");
  }
  return bad_input("cannot be opened as HDF5: " + reason);
}

}  // namespace bolo::capture
