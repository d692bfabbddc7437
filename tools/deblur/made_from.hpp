// Record of an output's inputs and settings, to detect later whether it is up to date.
#pragma once

#include <filesystem>
#include <string>

#include "src/capture/capture.hpp"
#include "src/core/result.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// Root attribute of outputs in a folder, written last of all: what has it is whole.
inline constexpr const char* kMadeFrom = "made_from";

// CRC-32 of a file. kBadInput when it cannot be read. Thread: any.
Result<std::uint64_t> checksum_of_file(const std::filesystem::path& file);

// The settings, checksums of profile, maps and points, and of the input its size, times, numbers, first and last frame;
// the same text for the same work. A change of other pixels alone is seen by the input's being newer (is_made()).
// kBadInput when a file cannot be read. Thread: any one at a time.
Result<std::string> made_from(const DeblurRequest& request, const capture::CaptureReader& input);

// `output` is there, whole, made from that, and not older than `input`. Thread: any one at a time.
bool is_made(const std::filesystem::path& output, const std::filesystem::path& input, const std::string& made_from);

// A recording that was cut off waits for `bolo recover` under the name that `output` has while it is written. Thread:
// any one at a time.
bool is_unfinished_recording(const std::filesystem::path& output);

// Another process is writing `output`. Thread: any.
bool is_being_made(const std::filesystem::path& output);

}  // namespace bolo::tools
