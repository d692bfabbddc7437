// HDF5 files as CrashSafeFiles: each H5Fflush is a commit.
#pragma once

#include <filesystem>
#include <memory>

#include "src/capture/crash_safe_file.hpp"
#include "src/capture/h5.hpp"

namespace bolo::capture {

// Shared by HDF5's handle of a file and its writer. HDF5 crashes after a file that it could not close. So, once
// `ending` is set, a failed write (a full disk) is noted here and hidden from HDF5; the file stays at the previous
// commit.
struct DrivenFile {
  std::unique_ptr<CrashSafeFile> file;
  bool writes = false;
  bool salvages = false;
  bool ending = false;
  bool erred = false;  // a read or a write failed: HDF5's state may be inconsistent
  int error = 0;       // errno of a failure since `ending`
  int read_error = 0;  // errno of a failed disk read since check_reads()
};

// A new HDF5 file of that name. `driven` holds it open for writing, also after HDF5 has closed it: its owner must
// finish it. Errors (without the file's name): no memory, no room. Thread: any one at a time.
Result<h5::Handle> create_hdf5(const std::filesystem::path& name, const std::shared_ptr<DrivenFile>& driven);

// Opens a file with the pages of the records beside it. `salvage`: also a file shorter than its structure states;
// reading the missing part fails. Errors (kBadInput, without the file's name): missing, not HDF5 (with its kind, if
// recognised), cut off, being written by another program. Thread: any one at a time.
Result<h5::Handle> open_hdf5(const std::filesystem::path& file, bool salvage = false);

// HDF5 takes data that the disk fails to deliver (a bad sector, a network) for absent: after looking for optional items
// this tells whether a read failed. Errors (kBadInput, without the file's name). Thread: any one at a time.
Status check_reads(hid_t file);

}  // namespace bolo::capture
