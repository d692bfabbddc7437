// Captures, pictures and raw dumps as footage.
#include "tools/convert/footage.hpp"

#include <algorithm>
#include <bit>
#include <cctype>
#include <fstream>
#include <system_error>

#include <fmt/format.h>

#include "src/core/byte_order.hpp"
#include "src/core/input_file.hpp"
#include "src/core/statistics.hpp"
#include "tools/convert/flir_still.hpp"

namespace bolo::tools {
namespace {

using capture::CaptureReader;

// Floating-point values are kelvin.
LinearScale scale_of(PixelType type, const StatedFormat& stated) {
  if (type == PixelType::kFloat32) return {Unit::kKelvin, 1.0, 0.0};
  return stated.scale.value_or(LinearScale{Unit::kCount, 1.0, 0.0});
}

class CaptureFootage final : public Footage {
 public:
  explicit CaptureFootage(CaptureReader reader) : reader_(std::move(reader)) { info_ = reader_.info(); }

  Status read(std::size_t index, Frame& frame) override {
    frame.t_s = reader_.t()[index];
    frame.id = reader_.frame_id()[index];
    frame.times = capture::times_of(reader_, index);
    return reader_.read_frame(index, frame.resize(info_.format.type, info_.format.geometry.pixels()));
  }

  const std::vector<double>& t() const noexcept { return reader_.t(); }

  Result<Extras> extras() const override {
    ASSIGN_OR_RETURN(auto attributes, reader_.attributes());
    // A faulty stimulus is left out; it was reported when the file was opened.
    return Extras{reader_.events(), std::move(attributes), reader_.stimulus().value_or(capture::NoStimulus{})};
  }

 private:
  CaptureReader reader_;
};

class MergedFootage final : public Footage {
 public:
  explicit MergedFootage(std::vector<std::unique_ptr<CaptureFootage>> footages) : footages_(std::move(footages)) {
    for (std::size_t part = 0; part < footages_.size(); ++part) {
      const std::vector<double>& t = footages_[part]->t();
      for (std::size_t i = 0; i < t.size(); ++i) turns_.push_back({t[i], part, i});
    }
    std::ranges::stable_sort(turns_, {}, &Turn::t_s);
    info_ = footages_.front()->info();
    info_.frames = turns_.size();
  }

  Status read(std::size_t index, Frame& frame) override {
    const Turn& turn = turns_[index];
    frame.part = turn.part;
    return footages_[turn.part]->read(turn.index, frame);
  }

  std::vector<const Footage*> parts() const override {
    return mapped(footages_, [](const auto& footage) -> const Footage* { return footage.get(); });
  }

 private:
  struct Turn {
    double t_s;
    std::size_t part;
    std::size_t index;  // within its part
  };
  std::vector<std::unique_ptr<CaptureFootage>> footages_;
  std::vector<Turn> turns_;
};

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

std::string size_text(Geometry g) { return fmt::format("{}x{}", g.width, g.height); }

class PictureFootage final : public Footage {
 public:
  // The first picture determines size and type of all.
  static Result<std::unique_ptr<Footage>> open(std::vector<Place> places, const StatedFormat& stated) {
    auto footage = std::unique_ptr<PictureFootage>(new PictureFootage(std::move(places)));
    ASSIGN_OR_RETURN(Picture first, footage->read_picture(0));
    StreamFormat& format = footage->info_.format;
    format.geometry = first.geometry;
    format.type = first.type;
    format.frame_period_s = 1.0 / stated.rate_hz;
    format.scale = scale_of(format.type, stated);
    footage->info_.frames = footage->places_.size();
    return footage;
  }

  Status read(std::size_t index, Frame& frame) override {
    ASSIGN_OR_RETURN(Picture picture, read_picture(index));
    if (!(picture.geometry == info_.format.geometry) || picture.type != info_.format.type) {
      return bad_input(places_[index].file.string() + ": is " + size_text(picture.geometry) + ", the first one " +
                       size_text(info_.format.geometry) + ", or of another type; all must be alike");
    }
    frame.t_s = static_cast<double>(index) * info_.format.frame_period_s;
    frame.id = index;
    static_cast<Plane&>(frame) = std::move(picture);
    return {};
  }

 private:
  explicit PictureFootage(std::vector<Place> places) : places_(std::move(places)) {}

  Result<Picture> read_picture(std::size_t index) {
    return at(places_[index].file.string(), read_unnamed(places_[index]));
  }

  Result<Picture> read_page(const Place& place) {
    if (!tiff_ || tiff_file_ != place.file) {
      ASSIGN_OR_RETURN(tiff_, TiffReader::open(place.file));
      tiff_file_ = place.file;
    }
    return tiff_->read(place.page);
  }

  Result<Picture> read_unnamed(const Place& place) {
    const Kind kind = kind_of(place.file);
    if (kind == Kind::kPng) return read_png_picture(place.file);
    if (kind == Kind::kTiff) return read_page(place);
    ASSIGN_OR_RETURN(const FlirStill still, read_flir_still(place.file));
    info_.camera_model = still.camera_model;
    info_.camera_serial = still.camera_serial;
    return to_kelvin(still);
  }

  std::vector<Place> places_;
  std::optional<TiffReader> tiff_;  // reads `tiff_file_`
  std::filesystem::path tiff_file_;
};

static_assert(std::endian::native == std::endian::little, "values are read as the machine has them");

struct Dump {
  std::filesystem::path file;
  std::size_t first = 0;  // index of its first frame
};

class RawFootage final : public Footage {
 public:
  RawFootage(std::vector<Dump> dumps, std::size_t frames, const RawLayout& layout, const StatedFormat& stated)
      : dumps_(std::move(dumps)), layout_(layout) {
    StreamFormat& format = info_.format;
    format.geometry = layout.geometry;
    format.type = layout.type;
    format.frame_period_s = 1.0 / stated.rate_hz;
    format.scale = scale_of(format.type, stated);
    info_.frames = frames;
  }

  Status read(std::size_t index, Frame& frame) override {
    const Dump& dump = *std::prev(std::ranges::upper_bound(dumps_, index, {}, &Dump::first));
    RETURN_IF_ERROR(go_to(dump, index));
    frame.t_s = static_cast<double>(index) * info_.format.frame_period_s;
    frame.id = index;
    char* const out = static_cast<char*>(frame.resize(info_.format.type, layout_.geometry.pixels()));
    if (!in_.read(out, static_cast<std::streamsize>(frame_bytes()))) {
      return bad_input(dump.file.string() + ": frame " + std::to_string(index) + " cannot be read");
    }
    if (layout_.big_endian) {
      for (std::uint16_t& v : frame.u16) v = swap_bytes(v);
    }
    return {};
  }

 private:
  std::uint64_t frame_bytes() const { return plane_bytes(layout_.geometry, layout_.type); }

  Status go_to(const Dump& dump, std::size_t index) {
    if (open_ != &dump) in_ = std::ifstream(dump.file, std::ios::binary);
    open_ = &dump;
    in_.seekg(static_cast<std::streamoff>(layout_.skip_bytes + (index - dump.first) * frame_bytes()));
    return in_ ? Status{} : bad_input(dump.file.string() + ": cannot be opened");
  }

  std::vector<Dump> dumps_;
  RawLayout layout_;
  const Dump* open_ = nullptr;
  std::ifstream in_;  // reads `open_`
};

}  // namespace

Result<std::unique_ptr<Footage>> open_captures(const Files& files) {
  std::vector<std::unique_ptr<CaptureFootage>> footages;
  for (const std::filesystem::path& file : files) {
    ASSIGN_OR_RETURN(CaptureReader reader, CaptureReader::open(file));
    footages.push_back(std::make_unique<CaptureFootage>(std::move(reader)));
  }
  if (footages.size() == 1) return std::move(footages.front());
  return std::make_unique<MergedFootage>(std::move(footages));
}

Result<std::unique_ptr<Footage>> open_pictures(const Files& files, const StatedFormat& stated) {
  std::vector<Place> places;
  for (const std::filesystem::path& file : files) {
    std::size_t pages = 1;
    if (kind_of(file) == Kind::kUnknown) {
      return bad_input(file.string() +
                       ": expected .h5, .mat, .part, .mcap, .cptv, .png, .tiff or .jpg; a raw dump needs --raw WxH");
    }
    RETURN_IF_ERROR(open_input(file));
    if (kind_of(file) == Kind::kTiff) {
      ASSIGN_OR_RETURN(pages, at(file.string(), count_tiff_pages(file)));
    }
    for (std::size_t page = 0; page < pages; ++page) places.push_back({file, page});
  }
  return PictureFootage::open(std::move(places), stated);
}

Result<std::unique_ptr<Footage>> open_raw(const Files& files, const RawLayout& layout, const StatedFormat& stated) {
  const std::uint64_t frame_bytes = plane_bytes(layout.geometry, layout.type);
  std::vector<Dump> dumps;
  std::size_t frames = 0;
  for (const std::filesystem::path& file : files) {
    std::error_code error;
    const std::uint64_t size = std::filesystem::file_size(file, error);
    if (error) return bad_input(file.string() + ": " + error.message());
    const std::uint64_t data = size > layout.skip_bytes ? size - layout.skip_bytes : 0;
    if (data == 0 || data % frame_bytes != 0) {
      return bad_input(fmt::format("{}: {} bytes are not whole frames of {}; check --raw and --skip", file.string(),
                                   data, frame_bytes));
    }
    dumps.push_back({file, frames});
    frames += data / frame_bytes;
  }
  return std::make_unique<RawFootage>(std::move(dumps), frames, layout, stated);
}

}  // namespace bolo::tools
