// Single pictures in files. Errors don't name the file: the caller does.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::tools {

struct Picture {
  Geometry geometry;
  PixelType type = PixelType::kUint16;
  std::vector<std::uint16_t> u16;
  std::vector<float> f32;
};

// 8 bit become 16 by 257 v. Thread: any.
Result<Picture> read_png_picture(const std::filesystem::path& file);
Status write_png16(const std::filesystem::path& file, Geometry geometry, const std::uint16_t* plane);
Status write_png8(const std::filesystem::path& file, Geometry geometry, const std::uint8_t* plane);

// Pages of grey values, uint16 or float32. Thread: any one at a time.
Result<std::size_t> count_tiff_pages(const std::filesystem::path& file);
Result<Picture> read_tiff_page(const std::filesystem::path& file, std::size_t page);

// Many pages of a file in their order: each leads to the next only, so that a file of thousands is gone through once.
class TiffReader {
 public:
  static Result<TiffReader> open(const std::filesystem::path& file);
  // Counted from 0. One before the last that was read begins anew.
  Result<Picture> read(std::size_t page);

 private:
  struct Closer {
    void operator()(void* tiff) const;
  };
  explicit TiffReader(void* tiff) : tiff_(tiff) {}
  std::unique_ptr<void, Closer> tiff_;
  std::size_t at_ = 0;
};

class TiffWriter {
 public:
  static Result<TiffWriter> create(const std::filesystem::path& file);
  // One page more, in the plane's own type; LZW-compressed without loss.
  Status write(Geometry geometry, PixelType type, const void* plane);
  Status close();

 private:
  struct Closer {
    void operator()(void* tiff) const;
  };
  explicit TiffWriter(void* tiff) : tiff_(tiff) {}
  std::unique_ptr<void, Closer> tiff_;
};

}  // namespace bolo::tools
