#include "src/sim/scene.hpp"

namespace bolo::sim {
namespace {

// The index that mirror reflection with the border repeated gives `i` in [0, n).
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

}  // namespace

std::unique_ptr<const Scene> make_still_scene(capture::StillImage image) {
  return std::make_unique<StillScene>(std::move(image));
}

}  // namespace bolo::sim
