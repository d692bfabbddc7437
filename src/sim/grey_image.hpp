// Pictures as grey levels. Errors do not name the file: the caller does.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::sim {

struct GreyImage {
  int width = 0;
  int height = 0;
  std::vector<std::uint16_t> level;  // row-major, 0 black, 65535 white
};

inline constexpr std::uint64_t kMaxImagePixels = 64'000'000;

Result<GreyImage> read_png(const std::filesystem::path& file);
Result<GreyImage> read_jpeg(const std::filesystem::path& file);

}  // namespace bolo::sim
