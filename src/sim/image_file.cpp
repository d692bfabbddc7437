// Pictures as scenes: PNG, JPEG, HDF5.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <memory>
#include <string>

#include "src/sim/grey_image.hpp"
#include "src/sim/scene.hpp"

namespace bolo::sim {
namespace {

enum class FileKind { kPng, kJpeg, kHdf5 };

Result<FileKind> file_kind(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::array<char, 8> bytes{};
  if (!in || std::filesystem::is_directory(file)) {
    return bad_input(file.string() + ": cannot be opened; give a PNG, JPEG or HDF5 picture");
  }
  in.read(bytes.data(), bytes.size());
  const std::string_view head(bytes.data(), static_cast<std::size_t>(in.gcount()));
  if (head == "\x89PNG\r\n\x1a\n") return FileKind::kPng;
  if (head == "\x89HDF\r\n\x1a\n") return FileKind::kHdf5;
  if (head.starts_with("\xff\xd8\xff")) return FileKind::kJpeg;
  return bad_input(file.string() + ": neither PNG, JPEG nor HDF5 (by its first bytes)");
}

capture::StillImage in_kelvin(const GreyImage& grey, const GreySpan& span) {
  capture::StillImage image{grey.width, grey.height, {}};
  image.kelvin.resize(grey.level.size());
  std::ranges::transform(grey.level, image.kelvin.begin(), [&span](std::uint16_t level) {
    return static_cast<float>(span.cold_k + (span.hot_k - span.cold_k) * (level / 65535.0));
  });
  return image;
}

Result<capture::StillImage> read_kelvin(const std::filesystem::path& file) {
  Result<capture::StillImage> image = capture::read_still(file);
  if (!image) return image;
  const auto wrong = std::ranges::find_if(image->kelvin, [](float k) { return !(k > 0.0F && k < 1e4F); });
  if (wrong != image->kelvin.end()) {
    return bad_input(file.string() + ": image_k has the value " + std::to_string(*wrong) +
                     ", expected kelvin between 0 and 10000");
  }
  return image;
}

}  // namespace

Result<bool> has_grey_levels(const std::filesystem::path& file) {
  return file_kind(file).map([](FileKind kind) { return kind != FileKind::kHdf5; });
}

Result<capture::StillImage> read_image(const std::filesystem::path& file, const GreySpan& span) {
  const Result<FileKind> kind = file_kind(file);
  if (!kind) return tl::unexpected(kind.error());
  if (*kind == FileKind::kHdf5) return read_kelvin(file);
  const Result<GreyImage> grey = *kind == FileKind::kPng ? read_png(file) : read_jpeg(file);
  if (!grey) return at(file.string(), grey.error());
  return in_kelvin(*grey, span);
}

}  // namespace bolo::sim
