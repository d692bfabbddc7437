#include <png.h>

#include <utility>

#include "src/sim/scene.hpp"
#include "tools/convert/picture.hpp"

namespace bolo::tools {
namespace {

Status write_png(const std::filesystem::path& file, Geometry geometry, png_uint_32 format, const void* plane) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(geometry.width);
  image.height = static_cast<png_uint_32>(geometry.height);
  image.format = format;
  if (png_image_write_to_file(&image, file.c_str(), 0, plane, 0, nullptr) != 0) return {};
  return failed(std::string("cannot be written: ") + image.message);
}

}  // namespace

Result<Picture> read_png_picture(const std::filesystem::path& file) {
  Result<sim::GreyImage> image = sim::read_png(file);
  if (!image) return tl::unexpected<Error>(image.error());
  return Picture{{image->width, image->height}, PixelType::kUint16, std::move(image->level), {}};
}

Status write_png16(const std::filesystem::path& file, Geometry geometry, const std::uint16_t* plane) {
  return write_png(file, geometry, PNG_FORMAT_LINEAR_Y, plane);
}

Status write_png8(const std::filesystem::path& file, Geometry geometry, const std::uint8_t* plane) {
  return write_png(file, geometry, PNG_FORMAT_GRAY, plane);
}

}  // namespace bolo::tools
