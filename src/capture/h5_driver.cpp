#include "src/capture/h5_driver.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <new>
#include <string_view>
#include <utility>

#include "src/core/input_file.hpp"

namespace bolo::capture {
namespace {

constexpr haddr_t kMostAddress = (haddr_t{1} << 62U) - 1;

// Property of the access list for open_file().
struct Access {
  const std::shared_ptr<DrivenFile>* driven = nullptr;
};

// Handle of an open file; HDF5 itself accesses the first member only.
struct Driven {
  H5FD_t common;
  std::shared_ptr<DrivenFile> shared;
  haddr_t end = 0;  // of HDF5's allocation
};

Driven& self(H5FD_t* file) { return *reinterpret_cast<Driven*>(file); }
const Driven& self(const H5FD_t* file) { return *reinterpret_cast<const Driven*>(file); }

herr_t done_or_why(bool good, const char* what) {
  if (good) return 0;
  H5Epush2(H5E_DEFAULT, __FILE__, __func__, __LINE__, H5E_ERR_CLS, H5E_IO, H5E_WRITEERROR, "%s: %s", what,
           std::strerror(errno));
  return -1;
}

// HDF5 is C: no exception may pass through it.
template <typename Use>
bool within_memory(Use&& use) {
  try {
    return use();
  } catch (const std::bad_alloc&) {
    errno = ENOMEM;
    return false;
  }
}

// The outcome reported to HDF5: once the end has begun, a failure is noted instead.
bool outcome(DrivenFile& driven, bool good) {
  driven.erred |= !good;
  if (good || !driven.ending) return good;
  driven.error = errno != 0 ? errno : EIO;
  return true;
}

// HDF5 first tries to open a file to be created, to see whether it is open already: it never is.
H5FD_t* open_file(const char*, unsigned flags, hid_t access_list, haddr_t) {
  const auto* access = static_cast<const Access*>(H5Pget_driver_info(access_list));
  if (access == nullptr || ((flags & H5F_ACC_CREAT) != 0) != (*access->driven)->writes) return nullptr;
  Driven* driven = nullptr;
  if (!within_memory([&] { return (driven = new Driven{}) != nullptr; })) return nullptr;
  driven->shared = *access->driven;
  return &driven->common;
}

herr_t flush_file(H5FD_t* file, hid_t, hbool_t) {
  DrivenFile& driven = *self(file).shared;
  if (!driven.writes || driven.error != 0) return 0;
  const bool good = within_memory([&] { return driven.file->commit(self(file).end); });
  return done_or_why(outcome(driven, good), "cannot be committed");
}

herr_t close_file(H5FD_t* file) {
  const herr_t good = flush_file(file, H5P_DEFAULT, 0);
  delete &self(file);
  return good;
}

herr_t query_features(const H5FD_t*, unsigned long* flags) {
  if (flags == nullptr) return 0;
  *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
           H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
  return 0;
}

haddr_t allocated_end(const H5FD_t* file, H5FD_mem_t) { return self(file).end; }

herr_t set_allocated_end(H5FD_t* file, H5FD_mem_t, haddr_t end) {
  self(file).end = end;
  return 0;
}

haddr_t file_end(const H5FD_t* file, H5FD_mem_t) {
  const DrivenFile& driven = *self(file).shared;
  return driven.salvages ? kMostAddress : driven.file->size();
}

herr_t read_file(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t offset, std::size_t bytes, void* out) {
  DrivenFile& driven = *self(file).shared;
  const bool gone = driven.salvages && offset + bytes > driven.file->size();
  if (gone) errno = EIO;
  const bool good = !gone && driven.file->read(offset, bytes, out);
  driven.erred |= !good;
  if (!good && !gone) driven.read_error = errno != 0 ? errno : EIO;
  return done_or_why(good, "cannot be read");
}

herr_t give_driven(H5FD_t* file, hid_t, void** out) {
  *out = self(file).shared.get();
  return 0;
}

herr_t write_file(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t offset, std::size_t bytes, const void* data) {
  DrivenFile& driven = *self(file).shared;
  const bool good = within_memory([&] { return driven.file->write(offset, bytes, data); });
  return done_or_why(outcome(driven, good), "cannot be written");
}

// Postponed to the end: a later commit only grows the file.
herr_t truncate_file(H5FD_t*, hid_t, hbool_t) { return 0; }

// Like HDF5's own driver with "ignore when disabled".
herr_t lock_file(H5FD_t* file, hbool_t exclusive) {
  const int how = (exclusive != 0 ? LOCK_EX : LOCK_SH) | LOCK_NB;
  const bool good = flock(self(file).shared->file->descriptor(), how) == 0 || errno == ENOSYS || errno == ENOLCK;
  return done_or_why(good, "unable to lock file");
}

herr_t unlock_file(H5FD_t* file) {
  return done_or_why(flock(self(file).shared->file->descriptor(), LOCK_UN) == 0 || errno == ENOSYS,
                     "unable to unlock file");
}

H5FD_class_t driver_class() {
  H5FD_class_t driver{};
  driver.name = "bolo_crash_safe";
  driver.maxaddr = kMostAddress;
  driver.fc_degree = H5F_CLOSE_WEAK;
  driver.fapl_size = sizeof(Access);
  driver.open = open_file;
  driver.close = close_file;
  driver.query = query_features;
  driver.get_eoa = allocated_end;
  driver.set_eoa = set_allocated_end;
  driver.get_eof = file_end;
  driver.get_handle = give_driven;
  driver.read = read_file;
  driver.write = write_file;
  driver.flush = flush_file;
  driver.truncate = truncate_file;
  driver.lock = lock_file;
  driver.unlock = unlock_file;
  constexpr H5FD_mem_t kRawAndRest[H5FD_MEM_NTYPES] = H5FD_FLMAP_DICHOTOMY;
  std::copy(std::begin(kRawAndRest), std::end(kRawAndRest), driver.fl_map);
  return driver;
}

// File access through the driver; locks, except where the file system (some network mounts) cannot. Nothing on failure.
h5::Handle file_access(const std::shared_ptr<DrivenFile>& driven) {
  static const H5FD_class_t driver = driver_class();
  static const hid_t id = H5FDregister(&driver);
  h5::Handle list(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_file_locking(list.get(), true, true);
  const Access access{&driven};
  return id >= 0 && H5Pset_driver(list.get(), id, &access) >= 0 ? std::move(list) : h5::Handle();
}

constexpr std::string_view kOldMatlab = "MATLAB 5.0 MAT-file";

Status read_head(const std::filesystem::path& file, std::array<char, 128>& head) {
  if (is_kernels_file(file)) return bad_input("is made by the kernel; expected a capture");
  const UniqueFd descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!descriptor) return bad_input(std::string("cannot be opened: ") + std::strerror(errno));
  struct stat info {};
  const bool regular = fstat(descriptor.get(), &info) == 0 && S_ISREG(info.st_mode);
  if (!regular) return bad_input("is not a regular file; expected a capture");
  const ssize_t bytes = ::read(descriptor.get(), head.data(), head.size());
  if (bytes < 0) return bad_input(std::string("cannot be read: ") + std::strerror(errno));
  if (bytes == 0) return bad_input("is empty; expected a capture");
  return {};
}

}  // namespace

Result<h5::Handle> create_hdf5(const std::filesystem::path& name, const std::shared_ptr<DrivenFile>& driven) {
  driven->writes = true;
  if (!h5::has_memory_for_a_file()) return failed("cannot be created: not enough memory");
  const h5::Handle access = file_access(driven);
  h5::Handle file(access ? H5Fcreate(name.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access.get()) : H5I_INVALID_HID);
  if (!file) return failed("cannot be created" + h5::because());  // before `access` is closed, which clears the cause
  return file;
}

Result<h5::Handle> open_hdf5(const std::filesystem::path& file, bool salvage) {
  std::array<char, 128> head{};
  RETURN_IF_ERROR(read_head(file, head));
  if (std::string_view(head.data(), kOldMatlab.size()) == kOldMatlab) {
    return bad_input("is a MATLAB file before version 7.3; save it again with save(..., '-v7.3')");
  }
  if (H5Fis_hdf5(file.c_str()) == 0) return bad_input("is not an HDF5 file; expected a capture (.h5 or .mat v7.3)");
  ASSIGN_OR_RETURN(std::unique_ptr<CrashSafeFile> opened, CrashSafeFile::open(file));
  if (!h5::has_memory_for_a_file()) return failed("cannot be opened: not enough memory");
  const auto driven = std::make_shared<DrivenFile>();
  driven->file = std::move(opened);
  driven->salvages = salvage;
  const h5::Handle access = file_access(driven);
  if (!access) return bad_input("cannot be opened" + h5::because());
  h5::Handle handle(H5Fopen(file.c_str(), H5F_ACC_RDONLY, access.get()));
  if (handle) return handle;
  const std::string reason = h5::cause();
  if (reason.find("truncated") != std::string::npos) return bad_input("is cut off: " + reason);
  if (reason.find("lock") != std::string::npos) {
    return bad_input("is being written by another program; read it when that has ended (" + reason + ")");
  }
  return bad_input("cannot be opened as HDF5: " + reason);
}

Status check_reads(hid_t file) {
  void* driven = nullptr;
  if (H5Fget_vfd_handle(file, H5P_DEFAULT, &driven) < 0) return {};
  const int error = std::exchange(static_cast<DrivenFile*>(driven)->read_error, 0);
  if (error == 0) return {};
  return bad_input(std::string("cannot be read whole: ") + std::strerror(error));
}

}  // namespace bolo::capture
