// HDF5 files as CrashSafeFiles: each H5Fflush is a commit.
#pragma once

#include <filesystem>
#include <memory>

#include "src/capture/crash_safe_file.hpp"
#include "src/capture/h5.hpp"

namespace bolo::capture {

// Shared by HDF5's handle of a file and its writer. HDF5 crashes after a file that it could not close. So, once
// `ending` is set, a failed write (a full disk) is noted here and hidden from HDF5; nothing more is committed: the file
// stays at the commit before.
struct DrivenFile {
  std::unique_ptr<CrashSafeFile> file;
  bool writes = false;
  bool salvages = false;
  bool ending = false;
  bool erred = false;  // a read or a write failed: HDF5's state may be inconsistent
  int error = 0;       // errno of what failed since `ending`
  int read_error = 0;  // errno of a read that the disk failed at since check_reads()
};

// A new HDF5 file of that name, which `driven` has open for writing and keeps when HDF5 has closed it: its owner has to
// finish it. Errors (without the file's name): no memory, no room. Thread: any one at a time.
Result<h5::Handle> create_hdf5(const std::filesystem::path& name, const std::shared_ptr<DrivenFile>& driven);

// With what the records beside it lay over the file. `salvage`: a file that is shorter than its structure says opens
// too, reading what is gone fails. Errors (kBadInput, without the file's name): not there, not HDF5 (what it is, where
// that shows), cut off, being written by another program. Thread: any one at a time.
Result<h5::Handle> open_hdf5(const std::filesystem::path& file, bool salvage = false);

// HDF5 takes what the disk fails to give (a bad sector, a network) for what is not there: after looking for what need
// not be there this says whether that is so. Errors (kBadInput, without the file's name). Thread: any one at a time.
Status check_reads(hid_t file);

}  // namespace bolo::capture
