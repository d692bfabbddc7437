// Opening an HDF5 file for reading, with the reasons for failure told apart.
#pragma once

#include <filesystem>

#include "src/capture/h5.hpp"
#include "src/capture/h5_driver.hpp"

namespace bolo::capture {

// Errors (kBadInput, without the file's name): not there, not HDF5 (what it is, where that shows), cut off, being
// written by another program. What a journal beside it holds is laid over the file. Thread: any one at a time.
Result<h5::Handle> open_hdf5(const std::filesystem::path& file, FileUse use = FileUse::kRead);

// File access that locks where the file system can lock and goes without where it can't (some network mounts).
h5::Handle file_access();

}  // namespace bolo::capture
