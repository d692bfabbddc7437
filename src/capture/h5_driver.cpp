#include "src/capture/h5_driver.hpp"

#include <sys/file.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <memory>

namespace bolo::capture {
namespace {

constexpr haddr_t kMostAddress = (haddr_t{1} << 62U) - 1;

struct Access {
  FileUse use = FileUse::kRead;
  SurvivesCut survives = SurvivesCut::kProcess;
  std::unique_ptr<CrashSafeFile>* created = nullptr;  // of a file that is created, as is `last`
  LastWrites* last = nullptr;
};

// Handle of an open file; HDF5 itself accesses the first member only.
struct Driven {
  H5FD_t common;
  std::unique_ptr<CrashSafeFile> file;
  Access access;
  haddr_t end = 0;  // of what HDF5 has allocated
};

Driven& self(H5FD_t* file) { return *reinterpret_cast<Driven*>(file); }
const Driven& self(const H5FD_t* file) { return *reinterpret_cast<const Driven*>(file); }

herr_t done_or_why(bool good, const char* what) {
  if (good) return 0;
  H5Epush2(H5E_DEFAULT, __FILE__, __func__, __LINE__, H5E_ERR_CLS, H5E_IO, H5E_WRITEERROR, "%s: %s", what,
           std::strerror(errno));
  return -1;
}

// The outcome as HDF5 is to see it: after the end has begun a failure goes to LastWrites instead.
bool outcome(const Access& access, bool good) {
  if (good || access.last == nullptr || !access.last->begun) return good;
  access.last->error = errno != 0 ? errno : EIO;
  return true;
}

bool commit(Driven& driven) {
  const Access& access = driven.access;
  return access.last->error != 0 || outcome(access, driven.file->commit(driven.end));
}

// HDF5 first asks for a file to create as if it was there, to see whether it is open already: it never is.
H5FD_t* open_file(const char* name, unsigned flags, hid_t access_list, haddr_t) {
  const auto* access = static_cast<const Access*>(H5Pget_driver_info(access_list));
  if (access == nullptr) return nullptr;
  const bool creates = (flags & H5F_ACC_CREAT) != 0;
  if (creates != (access->use == FileUse::kCreate)) return nullptr;
  const Replace replace = (flags & H5F_ACC_EXCL) != 0 ? Replace::kNothing : Replace::kExisting;
  auto file = creates ? CrashSafeFile::create(name, access->survives, replace) : CrashSafeFile::open(name);
  if (!file) {
    H5Epush2(H5E_DEFAULT, __FILE__, __func__, __LINE__, H5E_ERR_CLS, H5E_IO, H5E_CANTOPENFILE, "%s",
             file.error().message.c_str());
    return nullptr;
  }
  auto* driven = new Driven{};
  driven->file = std::move(*file);
  driven->access = *access;
  return &driven->common;
}

herr_t flush_file(H5FD_t* file, hid_t, hbool_t) {
  Driven& driven = self(file);
  if (driven.access.use != FileUse::kCreate) return 0;
  return done_or_why(commit(driven), "cannot be committed");
}

herr_t close_file(H5FD_t* file) {
  const std::unique_ptr<Driven> driven(&self(file));
  if (driven->access.use != FileUse::kCreate) return 0;
  const bool good = commit(*driven);
  *driven->access.created = std::move(driven->file);
  return done_or_why(good, "cannot be committed");
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
  const Driven& driven = self(file);
  return driven.access.use == FileUse::kSalvage ? kMostAddress : driven.file->size();
}

herr_t read_file(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t offset, std::size_t bytes, void* out) {
  const Driven& driven = self(file);
  const bool gone = driven.access.use == FileUse::kSalvage && offset + bytes > driven.file->size();
  if (gone) errno = EIO;
  return done_or_why(!gone && driven.file->read(offset, bytes, out), "cannot be read");
}

herr_t write_file(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t offset, std::size_t bytes, const void* data) {
  Driven& driven = self(file);
  return done_or_why(outcome(driven.access, driven.file->write(offset, bytes, data)), "cannot be written");
}

// Until the end: a later commit only grows the file.
herr_t truncate_file(H5FD_t*, hid_t, hbool_t) { return 0; }

// As HDF5's own driver does with "ignore when disabled".
herr_t lock_file(H5FD_t* file, hbool_t exclusive) {
  const int how = (exclusive != 0 ? LOCK_EX : LOCK_SH) | LOCK_NB;
  const bool good = flock(self(file).file->descriptor(), how) == 0 || errno == ENOSYS || errno == ENOLCK;
  return done_or_why(good, "unable to lock file");
}

herr_t unlock_file(H5FD_t* file) {
  return done_or_why(flock(self(file).file->descriptor(), LOCK_UN) == 0 || errno == ENOSYS, "unable to unlock file");
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

bool set_driver(hid_t list, const Access& access) {
  static const H5FD_class_t driver = driver_class();
  static const hid_t id = H5FDregister(&driver);
  return id >= 0 && H5Pset_driver(list, id, &access) >= 0;
}

}  // namespace

bool open_crash_safe(hid_t access, FileUse use) { return set_driver(access, {.use = use}); }

bool create_crash_safe(hid_t access, SurvivesCut survives, std::unique_ptr<CrashSafeFile>& created, LastWrites& last) {
  return set_driver(access, {FileUse::kCreate, survives, &created, &last});
}

}  // namespace bolo::capture
