#include <png.h>

#include <bit>
#include <csetjmp>
#include <cstdio>
#include <memory>
#include <string>

#include "src/sim/grey_image.hpp"

namespace bolo::sim {
namespace {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

// One PNG being read. libpng reports errors by longjmp: each call that may jump sits in a function of its own that has
// no object with a destructor.
class PngReader {
 public:
  PngReader() {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, keep_message, ignore_warning);
    info_ = png_ != nullptr ? png_create_info_struct(png_) : nullptr;
  }
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  // Reads the header and asks for 16-bit grey in the machine's byte order, whatever is stored: an 8-bit level v becomes
  // 257 v, which is the same share of white.
  bool read_header(std::FILE* file) {
    if (info_ == nullptr || setjmp(png_jmpbuf(png_)) != 0) return false;
    png_init_io(png_, file);
    png_read_info(png_, info_);
    png_set_expand_16(png_);
    png_set_strip_alpha(png_);
    if ((png_get_color_type(png_, info_) & PNG_COLOR_MASK_COLOR) != 0) {
      png_set_rgb_to_gray_fixed(png_, PNG_ERROR_ACTION_NONE, PNG_RGB_TO_GRAY_DEFAULT, PNG_RGB_TO_GRAY_DEFAULT);
    }
    if constexpr (std::endian::native == std::endian::little) png_set_swap(png_);
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    return true;
  }

  bool read_pixels(png_bytepp rows) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_read_image(png_, rows);
    png_read_end(png_, nullptr);
    return true;
  }

  std::uint64_t width() const { return png_get_image_width(png_, info_); }
  std::uint64_t height() const { return png_get_image_height(png_, info_); }
  std::size_t row_bytes() const { return png_get_rowbytes(png_, info_); }
  const std::string& message() const { return message_; }

 private:
  static void keep_message(png_structp png, png_const_charp message) {
    static_cast<PngReader*>(png_get_error_ptr(png))->message_ = message;
    png_longjmp(png, 1);
  }
  static void ignore_warning(png_structp, png_const_charp) {}

  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  std::string message_;
};

}  // namespace

Result<GreyImage> read_png(const std::filesystem::path& file) {
  const std::unique_ptr<std::FILE, FileCloser> in(std::fopen(file.c_str(), "rb"));
  if (!in) return bad_input("cannot be opened");
  PngReader reader;
  const auto damaged = [&reader] { return bad_input("damaged PNG: " + reader.message()); };
  if (!reader.read_header(in.get())) return damaged();
  if (reader.width() * reader.height() > kMaxImagePixels) return bad_input("more than 64 million pixels");
  GreyImage image{static_cast<int>(reader.width()), static_cast<int>(reader.height()), {}};
  image.level.resize(reader.width() * reader.height());
  if (reader.row_bytes() != reader.width() * sizeof(std::uint16_t)) return bad_input("PNG of an unknown pixel format");
  std::vector<png_bytep> rows;
  for (std::uint64_t y = 0; y < reader.height(); ++y) {
    rows.push_back(reinterpret_cast<png_bytep>(image.level.data() + y * reader.width()));
  }
  if (!reader.read_pixels(rows.data())) return damaged();
  return image;
}

}  // namespace bolo::sim
