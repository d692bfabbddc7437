// Record of an output's inputs and settings, which tells later whether it is up to date.
#pragma once

#include <filesystem>
#include <string>

#include "src/capture/capture.hpp"
#include "src/core/result.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// Root attribute of outputs in a folder. It is written last, so an output that has it is complete.
inline constexpr const char* kMadeFrom = "made_from";

// CRC-32 of a file. kBadInput when it cannot be read. Thread: any.
Result<std::uint64_t> checksum_of_file(const std::filesystem::path& file);

// Text of the settings, of the checksums of profile, maps and points, and of the input's size, times, numbers, first
// and last frame: equal for equal work. Changes of other frames show in the input's modification time (is_made()).
// kBadInput when a file cannot be read. Thread: any one at a time.
Result<std::string> made_from(const DeblurRequest& request, const capture::CaptureReader& input);

// True if `output` exists, is complete, has this `made_from`, and is not older than `input`. Thread: any one at a time.
bool is_made(const std::filesystem::path& output, const std::filesystem::path& input, const std::string& made_from);

// True if the ".part" of `output` is an interrupted recording, which awaits `bolo recover`. Thread: any one at a time.
bool is_unfinished_recording(const std::filesystem::path& output);

// True if another process is writing `output`. Thread: any.
bool is_being_made(const std::filesystem::path& output);

}  // namespace bolo::tools
