// The rule for every file that our programs read, except captures and maps (read by HDF5): a regular file, or a link to
// one. A pipe or a file of the kernel (/proc) could block without end, a device be read without end. An error is
// reported at once.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo {

inline constexpr std::uint64_t kMostTextBytes = std::uint64_t{256} << 20U;  // limit for a table: millions of lines

// Files in which the kernel talks, such as /proc/kmsg and trace_pipe, call themselves regular; some are waited for
// without end, and what is read is gone for others. Thread: any.
bool is_kernels_file(const std::filesystem::path& file);

// Opens for reading, at the beginning. Errors (kBadInput) name the file. Thread: any.
Result<UniqueFd> open_input(const std::filesystem::path& file);

// The same as a stream, for reading piece by piece. Thread: any.
Result<std::ifstream> stream_input(const std::filesystem::path& file);

// The whole file. Errors also: larger than `most_bytes`, growing meanwhile, or a read error. Thread: any.
Result<std::string> read_input(const std::filesystem::path& file, std::uint64_t most_bytes = kMostTextBytes);

// First line of a small kernel file; empty when it cannot be read. Thread: any.
std::string first_line(const std::filesystem::path& file);

}  // namespace bolo
