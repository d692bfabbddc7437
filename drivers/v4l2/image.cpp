#include "drivers/v4l2/image.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

namespace bolo::v4l2 {
namespace {

double count_of(double physical, const LinearScale& scale) {
  return scale.unit == Unit::kKelvin ? (physical - scale.offset) / scale.scale : physical;
}

double counts_of_span(double physical, const LinearScale& scale) {
  return scale.unit == Unit::kKelvin ? physical / scale.scale : physical;
}

constexpr double kMaxCount = 65535.0;
constexpr std::byte kNeutral{128};  // chroma of grey

double kelvin_of(Y16Unit unit) { return unit == Y16Unit::k10mK ? 0.01 : 0.1; }

}  // namespace

std::string_view name(PixelFormat format) noexcept {
  if (format == PixelFormat::kY16) return "y16";
  return format == PixelFormat::kGrey ? "grey" : "yuyv";
}

std::size_t line_bytes(PixelFormat format, int width) noexcept {
  return static_cast<std::size_t>(width) * (format == PixelFormat::kGrey ? 1U : 2U);
}

Status check_width(PixelFormat format, int width) {
  if (format != PixelFormat::kYuyv || width % 2 == 0) return {};
  return bad_input("yuyv needs an even width, not " + std::to_string(width) + "; use grey");
}

Result<ImageMaker> ImageMaker::create(PixelFormat format, Y16Unit unit, Geometry geometry, const LinearScale& scale,
                                      const AgcOptions& agc) {
  RETURN_IF_ERROR(check_width(format, geometry.width));
  return ImageMaker(format, unit, geometry, scale, agc);
}

ImageMaker::ImageMaker(PixelFormat format, Y16Unit unit, Geometry geometry, const LinearScale& scale,
                       const AgcOptions& agc)
    : format_(format),
      agc_(scale, agc),
      image_(line_bytes(format, geometry.width) * static_cast<std::size_t>(geometry.height), kNeutral) {
  if (scale.unit != Unit::kKelvin) return;
  gain_ = scale.scale / kelvin_of(unit);
  offset_ = scale.offset / kelvin_of(unit);
}

std::span<const std::byte> ImageMaker::make(std::span<const std::uint16_t> plane, double dt_s, bool judge) noexcept {
  if (format_ == PixelFormat::kY16) {
    if (gain_ == 1.0 && offset_ == 0.0) {
      std::memcpy(image_.data(), plane.data(), plane.size_bytes());
      return image_;
    }
    auto* const out = reinterpret_cast<std::uint16_t*>(image_.data());
    for (std::size_t i = 0; i < plane.size(); ++i) {
      out[i] = static_cast<std::uint16_t>(std::clamp(gain_ * plane[i] + offset_ + 0.5, 0.0, kMaxCount));
    }
    return image_;
  }
  const CountRange range = agc_.next(plane, dt_s, judge);
  const std::size_t step = format_ == PixelFormat::kGrey ? 1 : 2;  // YUYV interleaves chroma bytes
  for (std::size_t i = 0; i < plane.size(); ++i) image_[step * i] = std::byte{grey(plane[i], range)};
  return image_;
}

Agc::Agc(const LinearScale& scale, const AgcOptions& options) : scale_(scale), options_(options) {}

void Agc::set_options(const AgcOptions& options) { options_ = options; }

CountRange Agc::next(std::span<const std::uint16_t> plane, double dt_s, bool judge) noexcept {
  if (options_.gain == Gain::kFixed) {
    range_ = {count_of(options_.low_k, scale_), count_of(options_.high_k, scale_)};
    measured_ = true;
    return range_;
  }
  if (!judge && measured_) return range_;
  const CountRange now = measure(plane);
  const double share =
      measured_ && options_.smooth_s > 0.0 ? -std::expm1(-std::max(dt_s, 0.0) / options_.smooth_s) : 1.0;
  range_.black += measured_ ? share * (now.black - range_.black) : now.black - range_.black;
  range_.white += measured_ ? share * (now.white - range_.white) : now.white - range_.white;
  measured_ = judge;  // an initial shutter frame sets the range only until the next frame
  return range_;
}

CountRange Agc::measure(std::span<const std::uint16_t> plane) noexcept {
  const std::size_t step = std::max<std::size_t>(1, (plane.size() + kMostSamples - 1) / kMostSamples);
  std::size_t count = 0;
  for (std::size_t i = 0; i < plane.size(); i += step) samples_[count++] = plane[i];
  const auto percentile = [&](double percent) {
    const auto index = static_cast<std::size_t>(std::lround(percent / 100.0 * static_cast<double>(count - 1)));
    auto* const at = samples_.data() + std::min(index, count - 1);
    std::nth_element(samples_.data(), at, samples_.data() + count);
    return static_cast<double>(*at);
  };
  const double black = percentile(options_.low_percent);
  const double white = percentile(options_.high_percent);
  const double least = std::max(1.0, counts_of_span(options_.least_span_k, scale_));
  const double middle = (black + white) / 2.0;
  const double half = std::max(white - black, least) / 2.0;
  return {middle - half, middle + half};
}

}  // namespace bolo::v4l2
