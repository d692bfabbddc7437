// The random words with which answers are sealed.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "src/core/result.hpp"

namespace bolo::tools::blind {

// 64 hexadecimal digits; kFailed when the system gives no random numbers. Thread: any.
Result<std::string> fresh_nonce();

// The file of a job folder's nonce.
std::filesystem::path nonce_file(const std::filesystem::path& job);

// The nonce that a job folder has, if it has one. kBadInput when the file is none or cannot be read. Thread: any.
Result<std::optional<std::string>> kept_nonce(const std::filesystem::path& job);

// A fresh nonce in a job folder, which is made when it is not there, or the one of whoever was faster. It is on the
// disk then, in a file that only its user may read. kBadInput when there can be no folder, kFailed when the disk fails.
// Thread: setup.
Result<std::string> keep_nonce(const std::filesystem::path& job);

}  // namespace bolo::tools::blind
