// A still image as an unlimited scene, and a scene panned along a path.
#include <algorithm>
#include <cmath>
#include <string>

#include "src/sim/field.hpp"

namespace bolo::sim {
namespace {

// Index in [0, n) of `i` by mirror reflection with the border repeated.
int mirrored(int i, int n) {
  const int period = 2 * n;
  const int phase = ((i % period) + period) % period;
  return phase < n ? phase : period - 1 - phase;
}

class StillScene final : public Scene {
 public:
  explicit StillScene(capture::StillImage image) : image_(std::move(image)) {}

  Geometry size() const override { return {image_.width, image_.height}; }

  capture::StillImage draw(Region region) const override {
    capture::StillImage out{region.width, region.height, {}};
    out.kelvin.reserve(Geometry{region.width, region.height}.pixels());
    for (int y = 0; y < region.height; ++y) {
      const auto row =
          static_cast<std::size_t>(mirrored(region.y + y, image_.height)) * static_cast<std::size_t>(image_.width);
      for (int x = 0; x < region.width; ++x) {
        out.kelvin.push_back(image_.kelvin[row + static_cast<std::size_t>(mirrored(region.x + x, image_.width))]);
      }
    }
    return out;
  }

 private:
  capture::StillImage image_;
};

class SceneField final : public Field {
 public:
  SceneField(capture::StillImage image, Path path, Geometry view)
      : image_(std::move(image)), path_(std::move(path)), view_(view) {}

  // The image is extended by its border pixels.
  void sample_from(double t_s, double column, int row, std::span<float> out) const noexcept override {
    const Position at = path_.at(t_s);
    const double left = std::clamp(at.x_px, 0.0, static_cast<double>(image_.width - view_.width)) + column;
    const double top = std::clamp(at.y_px, 0.0, static_cast<double>(image_.height - view_.height)) + row;
    const double inside = std::clamp(top, 0.0, static_cast<double>(image_.height - 1));
    const auto upper_row = static_cast<int>(inside);
    const float* const upper = image_row(upper_row);
    const float* const lower = image_row(std::min(upper_row + 1, image_.height - 1));
    const double whole = std::floor(left);
    const auto x_part = static_cast<float>(left - whole);
    const auto y_part = static_cast<float>(inside - upper_row);
    const auto value = [&](std::ptrdiff_t i, std::ptrdiff_t next) {
      const float above = (1.0F - x_part) * upper[i] + x_part * upper[next];
      const float below = (1.0F - x_part) * lower[i] + x_part * lower[next];
      return (1.0F - y_part) * above + y_part * below;
    };
    const auto first = static_cast<std::ptrdiff_t>(whole);
    const auto last = static_cast<std::ptrdiff_t>(image_.width) - 1;
    const auto size = static_cast<std::ptrdiff_t>(out.size());
    const auto inner = std::clamp<std::ptrdiff_t>(-first, 0, size);
    const auto inner_end = std::clamp<std::ptrdiff_t>(last - first, inner, size);
    const auto held = [&](std::ptrdiff_t x) {
      return value(std::clamp<std::ptrdiff_t>(first + x, 0, last), std::clamp<std::ptrdiff_t>(first + x + 1, 0, last));
    };
    float* const to = out.data();
    for (std::ptrdiff_t x = 0; x < inner; ++x) to[x] = held(x);
    for (std::ptrdiff_t x = inner; x < inner_end; ++x) to[x] = value(first + x, first + x + 1);
    for (std::ptrdiff_t x = inner_end; x < size; ++x) to[x] = held(x);
  }

  // The image is bilinear and the path linear between these instants, so T_ss is exactly quadratic.
  void instants(double from_s, double to_s, double, std::vector<double>& out) const override {
    path_.crossings(from_s, to_s, out);
  }

  Extremes extremes() const override {
    const auto [low, high] = std::ranges::minmax(image_.kelvin);
    return {low, high};
  }

  capture::Stimulus stimulus(double from_s, double to_s) const override {
    capture::SceneStimulus stimulus{image_.width, image_.height, image_.kelvin, {}, {}, {}};
    const auto add = [&stimulus](double t_s, Position p) {
      stimulus.t_s.push_back(t_s);
      stimulus.x_px.push_back(p.x_px);
      stimulus.y_px.push_back(p.y_px);
    };
    add(from_s, path_.at(from_s));
    for (const PathPoint& point : path_.points()) {
      if (point.t_s > from_s && point.t_s < to_s) add(point.t_s, {point.x_px, point.y_px});
    }
    add(to_s, path_.at(to_s));
    return stimulus;
  }

 private:
  const float* image_row(int y) const noexcept {
    return image_.kelvin.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(image_.width);
  }

  capture::StillImage image_;
  Path path_;
  Geometry view_;
};

// Pixel rectangle seen along the path. Rounding of the path must not add a pixel.
Region seen(const Path::Bounds& bounds, Geometry view) {
  constexpr double kRounding = 1e-6;
  const int left = static_cast<int>(std::floor(bounds.low.x_px + kRounding));
  const int top = static_cast<int>(std::floor(bounds.low.y_px + kRounding));
  const int right = static_cast<int>(std::ceil(bounds.high.x_px - kRounding)) + view.width;
  const int bottom = static_cast<int>(std::ceil(bounds.high.y_px - kRounding)) + view.height;
  return {left, top, right - left, bottom - top};
}

}  // namespace

std::unique_ptr<const Scene> make_still_scene(capture::StillImage image) {
  return std::make_unique<StillScene>(std::move(image));
}

std::unique_ptr<const Field> make_scene(capture::StillImage image, Path path, Geometry view) {
  return std::make_unique<SceneField>(std::move(image), std::move(path), view);
}

Position centred_origin(const Scene& scene, const Path& motion, Geometry view, double from_s, double to_s) {
  const Path::Bounds bounds = motion.bounds(from_s, to_s);
  const Geometry size = scene.size();
  return {std::round((size.width - view.width - bounds.low.x_px - bounds.high.x_px) / 2.0),
          std::round((size.height - view.height - bounds.low.y_px - bounds.high.y_px) / 2.0)};
}

Result<std::unique_ptr<const Field>> pan_over(const Scene& scene, const Path& motion, Position origin, Geometry view,
                                              double from_s, double to_s) {
  const Path path = motion.shifted(origin);
  const Path::Bounds bounds = path.bounds(from_s, to_s);
  const double pixels =
      (bounds.high.x_px - bounds.low.x_px + view.width + 1) * (bounds.high.y_px - bounds.low.y_px + view.height + 1);
  const double farthest = std::max(
      {std::abs(bounds.low.x_px), std::abs(bounds.low.y_px), std::abs(bounds.high.x_px), std::abs(bounds.high.y_px)});
  if (!(pixels <= kMaxCanvasPixels) || farthest > 1e9) {
    return bad_input("the path runs over " + std::to_string(pixels / 1e6) + " million pixels of the scene, at most " +
                     std::to_string(static_cast<int>(kMaxCanvasPixels / 1e6)) +
                     " million can be held; take fewer frames or a lower speed");
  }
  Region region = seen(bounds, view);
  const Geometry size = scene.size();
  if (region.inside(size)) region = {0, 0, size.width, size.height};
  const Position corner{static_cast<double>(-region.x), static_cast<double>(-region.y)};
  return make_scene(scene.draw(region), path.shifted(corner), view);
}

}  // namespace bolo::sim
