// Image files as scenes: PNG, JPEG, HDF5.
#include <png.h>
#include <turbojpeg.h>

#include <algorithm>
#include <array>
#include <bit>
#include <csetjmp>
#include <cstdio>
#include <fstream>
#include <memory>
#include <string>

#include "src/core/input_file.hpp"
#include "src/sim/field.hpp"

namespace bolo::sim {
namespace {

constexpr std::uint64_t kMaxPixels = 64'000'000;

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

// One PNG being read. libpng reports errors by longjmp: each call that may jump is in its own function without objects
// that have destructors.
class PngReader {
 public:
  PngReader() {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, keep_message, ignore_warning);
    info_ = png_ != nullptr ? png_create_info_struct(png_) : nullptr;
  }
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  // Reads the header and requests native 16-bit grey for any format: an 8-bit level v becomes 257 v (same fraction).
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

Result<GreyImage> read_jpeg(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(const std::string bytes, read_input(file));
  const auto* const jpeg = reinterpret_cast<const unsigned char*>(bytes.data());
  const std::unique_ptr<void, int (*)(tjhandle)> decoder(tjInitDecompress(), tjDestroy);
  if (!decoder) return failed("libturbojpeg does not start");
  const auto damaged = [&decoder] {
    return bad_input("damaged JPEG, or of a kind that cannot be read: " + std::string(tjGetErrorStr2(decoder.get())));
  };
  int width = 0;
  int height = 0;
  int subsampling = 0;
  int colours = 0;
  if (tjDecompressHeader3(decoder.get(), jpeg, bytes.size(), &width, &height, &subsampling, &colours) != 0) {
    return damaged();
  }
  const std::uint64_t pixels = static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  if (pixels > kMaxPixels) return bad_input("more than 64 million pixels");
  std::vector<unsigned char> grey(pixels);
  if (tjDecompress2(decoder.get(), jpeg, bytes.size(), grey.data(), width, 0, height, TJPF_GRAY, TJFLAG_ACCURATEDCT) !=
      0) {
    return damaged();
  }
  GreyImage image{width, height, {}};
  image.level.resize(pixels);
  std::ranges::transform(grey, image.level.begin(),
                         [](unsigned char level) { return static_cast<std::uint16_t>(257U * level); });
  return image;
}

enum class FileKind { kPng, kJpeg, kHdf5 };

Result<FileKind> file_kind(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(std::ifstream in, stream_input(file));
  std::array<char, 8> bytes{};
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

Result<GreyImage> read_png(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(const UniqueFd descriptor, open_input(file));
  const std::unique_ptr<std::FILE, FileCloser> in(::fdopen(::dup(descriptor.get()), "rb"));
  if (!in) return failed("cannot be opened");
  PngReader reader;
  const auto damaged = [&reader] { return bad_input("damaged PNG: " + reader.message()); };
  if (!reader.read_header(in.get())) return damaged();
  if (reader.width() * reader.height() > kMaxPixels) return bad_input("more than 64 million pixels");
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

Result<bool> has_grey_levels(const std::filesystem::path& file) {
  return file_kind(file).map([](FileKind kind) { return kind != FileKind::kHdf5; });
}

Result<capture::StillImage> read_image(const std::filesystem::path& file, const GreySpan& span) {
  ASSIGN_OR_RETURN(const FileKind kind, file_kind(file));
  if (kind == FileKind::kHdf5) return read_kelvin(file);
  ASSIGN_OR_RETURN(const GreyImage grey, at(file.string(), kind == FileKind::kPng ? read_png(file) : read_jpeg(file)));
  return in_kelvin(grey, span);
}

}  // namespace bolo::sim
