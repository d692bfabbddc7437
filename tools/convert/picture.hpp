// Single pictures in files. Errors omit the file's name: the caller adds it.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"

struct tiff;  // of libtiff: TIFF

namespace bolo::tools {

// Values of one type; the other vector is empty.
struct Plane {
  std::vector<std::uint16_t> u16;
  std::vector<float> f32;

  void* resize(PixelType type, std::size_t pixels) {
    u16.resize(type == PixelType::kUint16 ? pixels : 0);
    f32.resize(type == PixelType::kUint16 ? 0 : pixels);
    return u16.empty() ? static_cast<void*>(f32.data()) : static_cast<void*>(u16.data());
  }
  const void* data() const { return u16.empty() ? static_cast<const void*>(f32.data()) : u16.data(); }
};

struct Picture : Plane {
  Geometry geometry;
  PixelType type = PixelType::kUint16;
};

// 8-bit values v become 257 v. Thread: any.
Result<Picture> read_png_picture(const std::filesystem::path& file);
Status write_png16(const std::filesystem::path& file, Geometry geometry, const std::uint16_t* plane);
Status write_png8(const std::filesystem::path& file, Geometry geometry, const std::uint8_t* plane);

// Pages of uint16 or float32. Errors (kBadInput): not a TIFF, or a truncated one. Thread: any one at a time.
Result<std::size_t> count_tiff_pages(const std::filesystem::path& file);

struct TiffCloser {
  void operator()(tiff* file) const;
};
using TiffHandle = std::unique_ptr<tiff, TiffCloser>;

// Pages of a file in order. A page only links to the next, so this walks a file of thousands only once.
class TiffReader {
 public:
  static Result<TiffReader> open(const std::filesystem::path& file);
  // `page` counts from 0. A page before the last one read restarts the walk.
  Result<Picture> read(std::size_t page);

 private:
  explicit TiffReader(TiffHandle tiff) : tiff_(std::move(tiff)) {}
  TiffHandle tiff_;
  std::size_t at_ = 0;
};

class TiffWriter {
 public:
  static Result<TiffWriter> create(const std::filesystem::path& file);
  // Appends a page of this type, with lossless LZW compression.
  Status write(Geometry geometry, PixelType type, const void* plane);
  Status close();

 private:
  explicit TiffWriter(TiffHandle tiff) : tiff_(std::move(tiff)) {}
  TiffHandle tiff_;
};

}  // namespace bolo::tools
