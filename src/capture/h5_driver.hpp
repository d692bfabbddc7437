// HDF5 on a CrashSafeFile: each H5Fflush is a commit.
#pragma once

#include <memory>

#include "src/capture/crash_safe_file.hpp"
#include "src/capture/h5.hpp"

namespace bolo::capture {

enum class FileUse {
  kCreate,   // H5Fcreate
  kRead,     // H5Fopen, with what the records lay over the file
  kSalvage,  // as kRead; a file that is shorter than its structure says opens too, reading what is gone fails
};

// A file that is opened with the access list `access` is a CrashSafeFile. False on failure. Thread: any one at a time.
bool open_crash_safe(hid_t access, FileUse use);

// HDF5 ends in a crash after a file that it could not close. So, while the last writes of a file are made, one that
// fails (a full disk) is noted here and not told HDF5; nothing is committed any more: the file stays at the commit
// before.
struct LastWrites {
  bool begun = false;
  int error = 0;  // errno of the one that failed
};

// The same of a file that is created. When HDF5 closes it, it is committed and moved to `created`, whose owner has to
// finish it; until then `created` and `last` stay where they are.
bool create_crash_safe(hid_t access, SurvivesCut survives, std::unique_ptr<CrashSafeFile>& created, LastWrites& last);

}  // namespace bolo::capture
