// HDF5 on a CrashSafeFile: each H5Fflush is a commit.
#pragma once

#include "src/capture/crash_safe_file.hpp"
#include "src/capture/h5.hpp"

namespace bolo::capture {

enum class FileUse {
  kCreate,   // H5Fcreate
  kRead,     // H5Fopen, with what the journal lays over the file
  kSalvage,  // as kRead; a file that is shorter than its structure says opens too, reading what is gone fails
};

// Makes a file that is created or opened with the access list `access` a CrashSafeFile. False on failure. Thread: any
// one at a time.
bool use_crash_safe_file(hid_t access, FileUse use, SurvivesCut survives = SurvivesCut::kProcess);

}  // namespace bolo::capture
