#include "tools/lab/detect/picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace bolo::tools::detect {
namespace {

constexpr float kAround = 128.0F;  // grey level beside a letterboxed picture

// For each place along one side of the input: the two pixels around it and the second one's weight; `inside` is false
// beside the picture.
struct Between {
  std::size_t first = 0;
  std::size_t second = 0;
  float weight = 0.0F;
  bool inside = true;
};

std::vector<Between> places_along(int input, int picture, double scale, double offset) {
  std::vector<Between> places;
  for (int i = 0; i < input; ++i) {
    const double at = (i + 0.5 - offset) / scale;  // edges at whole numbers
    const double centred = std::clamp(at - 0.5, 0.0, picture - 1.0);
    const auto first = static_cast<std::size_t>(centred);
    places.push_back({first, std::min(first + 1, static_cast<std::size_t>(picture) - 1),
                      static_cast<float>(centred - static_cast<double>(first)), at >= 0.0 && at < picture});
  }
  return places;
}

Levels resized(const Levels& levels, Geometry picture, Geometry input, const Fit& fit) {
  const std::vector<Between> columns = places_along(input.width, picture.width, fit.scale_x, fit.left);
  const std::vector<Between> rows = places_along(input.height, picture.height, fit.scale_y, fit.top);
  Levels out;
  out.reserve(input.pixels());
  const auto width = static_cast<std::size_t>(picture.width);
  for (const Between& row : rows) {
    const float* const upper = levels.data() + row.first * width;
    const float* const lower = levels.data() + row.second * width;
    for (const Between& column : columns) {
      const float above = std::lerp(upper[column.first], upper[column.second], column.weight);
      const float below = std::lerp(lower[column.first], lower[column.second], column.weight);
      out.push_back(row.inside && column.inside ? std::lerp(above, below, row.weight) : kAround);
    }
  }
  return out;
}

}  // namespace

Levels levels_of(std::span<const float> kelvin, double cold_k, double hot_k) {
  Levels levels(kelvin.size());
  const double scale = 255.0 / (hot_k - cold_k);
  std::ranges::transform(kelvin, levels.begin(), [&](float k) {
    return static_cast<float>(std::clamp(std::round((static_cast<double>(k) - cold_k) * scale), 0.0, 255.0));
  });
  return levels;
}

Box Fit::to_picture(const Box& in) const {
  return {(in.x - left) / scale_x, (in.y - top) / scale_y, in.width / scale_x, in.height / scale_y};
}

Fit fit_of(Geometry picture, Geometry input, Resize resize) {
  const double x = static_cast<double>(input.width) / picture.width;
  const double y = static_cast<double>(input.height) / picture.height;
  if (resize == Resize::kStretch) return {x, y, 0.0, 0.0};
  const double scale = std::min(x, y);
  return {scale, scale, (input.width - scale * picture.width) / 2.0, (input.height - scale * picture.height) / 2.0};
}

Tensor input_of(const Levels& levels, Geometry picture, const DetectorDescription& d) {
  const Levels grey = resized(levels, picture, d.input, fit_of(picture, d.input, d.resize));
  Tensor input{{1, 3, d.input.height, d.input.width}, {}};
  input.values.reserve(3 * grey.size());
  std::array<const Channel*, 3> channels{&d.red, &d.green, &d.blue};
  if (d.order == ChannelOrder::kBgr) std::ranges::reverse(channels);
  for (const Channel* channel : channels) {
    for (const float level : grey) {
      input.values.push_back(static_cast<float>((static_cast<double>(level) - channel->mean) * channel->scale));
    }
  }
  return input;
}

}  // namespace bolo::tools::detect
