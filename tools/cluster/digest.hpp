// SHA-256 of texts and files, in 64 hexadecimal digits.
#pragma once

#include <filesystem>
#include <string>

#include "src/core/result.hpp"

namespace bolo::tools::cluster {

// Thread: any.
std::string sha256(const std::string& text);

// kBadInput when it cannot be read. Thread: any.
Result<std::string> sha256_of(const std::filesystem::path& file);

}  // namespace bolo::tools::cluster
