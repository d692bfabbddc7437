#include <algorithm>
#include <cctype>
#include <string>
#include <utility>

#include "tools/convert/flir_still.hpp"
#include "tools/convert/footage.hpp"
#include "tools/convert/picture.hpp"

namespace bolo::tools {
namespace {

enum class Kind { kPng, kTiff, kFlirStill, kUnknown };

Kind kind_of(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension == ".png") return Kind::kPng;
  if (extension == ".tif" || extension == ".tiff") return Kind::kTiff;
  if (extension == ".jpg" || extension == ".jpeg") return Kind::kFlirStill;
  return Kind::kUnknown;
}

struct Place {
  std::filesystem::path file;
  std::size_t page = 0;
};

std::string size_text(Geometry g) { return std::to_string(g.width) + "x" + std::to_string(g.height); }

class PictureFootage final : public Footage {
 public:
  // The first picture decides what all of them must be.
  static Result<std::unique_ptr<Footage>> open(std::vector<Place> places, const Told& told) {
    auto footage = std::unique_ptr<PictureFootage>(new PictureFootage(std::move(places)));
    Result<Picture> first = footage->read_picture(0);
    if (!first) return tl::unexpected<Error>(first.error());
    StreamFormat& format = footage->info_.format;
    format.geometry = first->geometry;
    format.type = first->type;
    format.frame_period_s = 1.0 / told.rate_hz;
    format.scale = scale_of(format.type, told);
    footage->info_.frames = footage->places_.size();
    return footage;
  }

  Status read(std::size_t index, Frame& frame) override {
    Result<Picture> picture = read_picture(index);
    if (!picture) return tl::unexpected<Error>(picture.error());
    if (!(picture->geometry == info_.format.geometry) || picture->type != info_.format.type) {
      return bad_input(places_[index].file.string() + ": is " + size_text(picture->geometry) + ", the first one " +
                       size_text(info_.format.geometry) + ", or of another type; all must be alike");
    }
    frame.t_s = static_cast<double>(index) * info_.format.frame_period_s;
    frame.id = index;
    frame.u16 = std::move(picture->u16);
    frame.f32 = std::move(picture->f32);
    return {};
  }

 private:
  explicit PictureFootage(std::vector<Place> places) : places_(std::move(places)) {}

  Result<Picture> read_picture(std::size_t index) {
    const Place& place = places_[index];
    Result<Picture> picture = read_unnamed(place);
    if (!picture) return at(place.file.string(), picture.error());
    return picture;
  }

  Result<Picture> read_unnamed(const Place& place) {
    switch (kind_of(place.file)) {
      case Kind::kPng:
        return read_png_picture(place.file);
      case Kind::kTiff:
        return read_tiff_page(place.file, place.page);
      default:
        break;
    }
    const Result<FlirStill> still = read_flir_still(place.file);
    if (!still) return tl::unexpected<Error>(still.error());
    info_.camera_model = still->camera_model;
    info_.camera_serial = still->camera_serial;
    return to_kelvin(*still);
  }

  std::vector<Place> places_;
};

}  // namespace

Result<std::unique_ptr<Footage>> open_pictures(const Files& files, const Told& told) {
  std::vector<Place> places;
  for (const std::filesystem::path& file : files) {
    std::size_t pages = 1;
    if (kind_of(file) == Kind::kUnknown) {
      return bad_input(file.string() + ": expected .h5, .mat, .part, .png, .tiff or .jpg; a raw dump needs --raw WxH");
    }
    if (kind_of(file) == Kind::kTiff) {
      const Result<std::size_t> counted = count_tiff_pages(file);
      if (!counted) return at(file.string(), counted.error());
      pages = *counted;
    }
    for (std::size_t page = 0; page < pages; ++page) places.push_back({file, page});
  }
  return PictureFootage::open(std::move(places), told);
}

}  // namespace bolo::tools
