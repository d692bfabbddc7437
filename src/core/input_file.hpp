// One rule for every file that a program of ours reads, captures and maps (which HDF5 reads) aside: a regular one, or a
// link to one. A pipe would be waited for without end, a device be read without end. No error is ever a wait.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo {

inline constexpr std::uint64_t kMostTextBytes = std::uint64_t{256} << 20U;  // of a table: millions of lines

// Open for reading, at its begin. Errors (kBadInput) name the file. Thread: any.
Result<UniqueFd> open_input(const std::filesystem::path& file);

// The same as a stream, for what is read piece by piece. Thread: any.
Result<std::ifstream> stream_input(const std::filesystem::path& file);

// All of it. Errors: also one that is larger, which grows meanwhile, or that the disk does not give. Thread: any.
Result<std::string> read_input(const std::filesystem::path& file, std::uint64_t most_bytes = kMostTextBytes);

// The first line of a small file of the kernel's; empty when it cannot be read. Thread: any.
std::string first_line(const std::filesystem::path& file);

}  // namespace bolo
