// Scenes: temperatures over a plane of pixels, drawn where they are needed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/geometry.hpp"
#include "src/core/result.hpp"

namespace bolo::sim {

class Scene {
 public:
  virtual ~Scene() = default;
  // Size of the scene's subject: [0, width) x [0, height). The scene goes on beyond.
  virtual Geometry size() const = 0;
  // The temperatures of a rectangle anywhere in the plane, K; the same pixel has the same value whatever the rectangle.
  // Thread: setup.
  virtual capture::StillImage draw(Region region) const = 0;
};

// A still. Beyond its borders it goes on by mirror reflection, the border pixel repeated: ..b a | a b c | c b..
std::unique_ptr<const Scene> make_still_scene(capture::StillImage image);

// An endless street in the evening as a thermal camera sees it, 278 to 311 K. `view` is the frame it is composed for:
// its height spans from the roofs to the road. Each seed is another street. Thread: setup.
std::unique_ptr<const Scene> make_street(Geometry view, std::uint64_t seed);

// Temperatures of a picture's grey levels: black is cold_k, white hot_k, linear between.
struct GreySpan {
  double cold_k = 285.0;
  double hot_k = 310.0;
};

// Reads PNG (8 or 16 bit, grey or colour: colour becomes its luma), JPEG, or HDF5 with `image_k` in kelvin, told apart
// by their first bytes. kBadInput when the file is none of them, damaged, or over 64 million pixels. Thread: setup.
Result<capture::StillImage> read_image(const std::filesystem::path& file, const GreySpan& span);

// True if a picture's values come from grey levels (PNG, JPEG) rather than kelvin (HDF5).
Result<bool> has_grey_levels(const std::filesystem::path& file);

// A picture as grey levels.
struct GreyImage {
  int width = 0;
  int height = 0;
  std::vector<std::uint16_t> level;  // row-major, 0 black, 65535 white
};

// kBadInput, which does not name the file, as read_image(). Thread: setup.
Result<GreyImage> read_png(const std::filesystem::path& file);

}  // namespace bolo::sim
