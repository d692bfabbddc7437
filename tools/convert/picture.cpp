#include "tools/convert/picture.hpp"

#include <cerrno>
#include <cstring>

#include <fmt/format.h>
#include <png.h>
#include <tiffio.h>

#include "src/sim/field.hpp"

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

constexpr std::uint64_t kMostPixels = 64'000'000;

constexpr const char* kRead = "rm";  // no mmap: a file truncated meanwhile would raise SIGBUS

// Keeps libtiff from printing errors: they are returned as values.
TiffHandle open_tiff(const std::filesystem::path& file, const char* mode) {
  TIFFSetErrorHandler(nullptr);
  TIFFSetWarningHandler(nullptr);
  return TiffHandle(TIFFOpen(file.c_str(), mode));
}

struct Layout {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::uint16_t bits = 1;
  std::uint16_t samples = 1;
  std::uint16_t format = SAMPLEFORMAT_UINT;
};

Layout layout_of(TIFF* tiff) {
  Layout layout;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &layout.width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &layout.height);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &layout.bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &layout.samples);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &layout.format);
  return layout;
}

Status read_rows(TIFF* tiff, const Layout& layout, std::byte* out) {
  const std::size_t row_bytes = std::size_t{layout.width} * layout.bits / 8;
  if (TIFFIsTiled(tiff) != 0 || TIFFScanlineSize64(tiff) != row_bytes) {
    return bad_input("TIFF in tiles or of an unknown layout; expected rows");
  }
  for (std::uint32_t y = 0; y < layout.height; ++y) {
    if (TIFFReadScanline(tiff, out + y * row_bytes, y) < 0) return bad_input("damaged TIFF: a row cannot be read");
  }
  return {};
}

}  // namespace

Result<Picture> read_png_picture(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(sim::GreyImage image, sim::read_png(file));
  return Picture{{std::move(image.level), {}}, {image.width, image.height}, PixelType::kUint16};
}

Status write_png16(const std::filesystem::path& file, Geometry geometry, const std::uint16_t* plane) {
  return write_png(file, geometry, PNG_FORMAT_LINEAR_Y, plane);
}

Status write_png8(const std::filesystem::path& file, Geometry geometry, const std::uint8_t* plane) {
  return write_png(file, geometry, PNG_FORMAT_GRAY, plane);
}

void TiffCloser::operator()(tiff* file) const { TIFFClose(file); }

Result<std::size_t> count_tiff_pages(const std::filesystem::path& file) {
  const TiffHandle tiff = open_tiff(file, kRead);
  if (!tiff) return bad_input("cannot be opened as TIFF");
  std::size_t pages = 1;
  while (TIFFLastDirectory(tiff.get()) == 0) {
    if (TIFFReadDirectory(tiff.get()) == 0) {  // also fails on a cycle of pages, or more than a million
      return bad_input("is cut off or damaged: of its pages only " + std::to_string(pages) + " can be read");
    }
    ++pages;
  }
  return pages;
}

Result<TiffReader> TiffReader::open(const std::filesystem::path& file) {
  TiffHandle tiff = open_tiff(file, kRead);
  if (!tiff) return bad_input("cannot be opened as TIFF");
  return TiffReader(std::move(tiff));
}

Result<Picture> TiffReader::read(std::size_t page) {
  TIFF* const tiff = tiff_.get();
  if (page < at_) {
    if (TIFFSetDirectory(tiff, 0) == 0) return bad_input("damaged TIFF: its first page cannot be read");
    at_ = 0;
  }
  for (; at_ < page; ++at_) {
    if (TIFFReadDirectory(tiff) == 0) {
      return bad_input("damaged TIFF: page " + std::to_string(at_ + 1) + " cannot be read");
    }
  }
  const Layout layout = layout_of(tiff);
  const bool is_float = layout.format == SAMPLEFORMAT_IEEEFP && layout.bits == 32;
  const bool is_uint16 = layout.format == SAMPLEFORMAT_UINT && layout.bits == 16;
  if (layout.samples != 1 || (!is_float && !is_uint16)) {
    return bad_input(fmt::format("TIFF with {} values of {} bits a pixel; expected one of uint16 or float32",
                                 layout.samples, layout.bits));
  }
  const std::uint64_t pixels = std::uint64_t{layout.width} * layout.height;
  if (pixels == 0 || pixels > kMostPixels) return bad_input("TIFF of no size, or of more than 64 million pixels");
  Picture picture;
  picture.geometry = {static_cast<int>(layout.width), static_cast<int>(layout.height)};
  picture.type = is_float ? PixelType::kFloat32 : PixelType::kUint16;
  RETURN_IF_ERROR(read_rows(tiff, layout, static_cast<std::byte*>(picture.resize(picture.type, pixels))));
  return picture;
}

Result<TiffWriter> TiffWriter::create(const std::filesystem::path& file) {
  TiffHandle tiff = open_tiff(file, "w8");  // BigTIFF: long recordings exceed 4 GB
  const std::string why = std::string("cannot be created: ") + std::strerror(errno);
  if (!tiff) return errno == ENOSPC || errno == EDQUOT ? failed(why) : bad_input(why);
  return TiffWriter(std::move(tiff));
}

Status TiffWriter::write(Geometry geometry, PixelType type, const void* plane) {
  TIFF* const tiff = tiff_.get();
  const bool is_float = type == PixelType::kFloat32;
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, static_cast<std::uint32_t>(geometry.width));
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, static_cast<std::uint32_t>(geometry.height));
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8 * static_cast<int>(bytes_of(type)));
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, is_float ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_LZW);
  TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, static_cast<std::uint32_t>(geometry.height));
  const auto bytes = static_cast<tmsize_t>(plane_bytes(geometry, type));
  const bool good =
      TIFFWriteEncodedStrip(tiff, 0, const_cast<void*>(plane), bytes) == bytes && TIFFWriteDirectory(tiff) != 0;
  return good ? Status{} : failed(std::string("cannot be written: ") + std::strerror(errno));
}

Status TiffWriter::close() {
  const bool good = TIFFFlush(tiff_.get()) != 0;
  tiff_.reset();
  return good ? Status{} : failed(std::string("cannot be written: ") + std::strerror(errno));
}

}  // namespace bolo::tools
