// Input of the pixels: the steady-state temperature T_ss of each pixel at any time. A field knows its structure in
// time, so that it is integrated exactly, or to a stated error, in few steps.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/sim/path.hpp"

namespace bolo::sim {

// --- Scenes: temperatures over a plane of pixels, drawn on demand.

class Scene {
 public:
  virtual ~Scene() = default;
  // Size of the scene's subject: [0, width) x [0, height). The scene continues beyond it.
  virtual Geometry size() const = 0;
  // Temperatures of any rectangle of the plane, K; a pixel's value is the same in every rectangle. Thread: setup.
  virtual capture::StillImage draw(Region region) const = 0;
};

// A still image, continued by mirror reflection with the border pixel repeated: ..b a | a b c | c b..
std::unique_ptr<const Scene> make_still_scene(capture::StillImage image);

// An endless evening street as seen by a thermal camera, 278 to 311 K. `view`: frame it is composed for, from the roofs
// to the road. Each seed is another street. Thread: setup.
std::unique_ptr<const Scene> make_street(Geometry view, std::uint64_t seed);

// Grey levels to temperatures: black is cold_k, white hot_k, linear between.
struct GreySpan {
  double cold_k = 285.0;
  double hot_k = 310.0;
};

// Reads PNG (8 or 16 bit, grey or colour: colour becomes its luma), JPEG, or HDF5 with `image_k` in kelvin, detected by
// the first bytes. kBadInput: none of them, damaged, or over 64 million pixels. Thread: setup.
Result<capture::StillImage> read_image(const std::filesystem::path& file, const GreySpan& span);

// True if the image has grey levels (PNG, JPEG) rather than kelvin (HDF5).
Result<bool> has_grey_levels(const std::filesystem::path& file);

struct GreyImage {
  int width = 0;
  int height = 0;
  std::vector<std::uint16_t> level;  // row-major, 0 black, 65535 white
};

// kBadInput as read_image(), but without the file's name. Thread: setup.
Result<GreyImage> read_png(const std::filesystem::path& file);

// Lowest and highest T_ss of any pixel at any time, K.
struct Extremes {
  double low_k = 0.0;
  double high_k = 0.0;
};

// Point spread function of the optics: a Gaussian, or a disc of radius 2 sigma with the same variance.
struct Blur {
  double sigma_px = 0.0;  // along each axis
  bool disc = false;
};

class Field {
 public:
  virtual ~Field() = default;

  // T_ss of the pixels (0, row), (1, row) ... at t, K; at a jump the value after it. Thread: any.
  void sample(double t_s, int row, std::span<float> out) const noexcept { sample_from(t_s, 0.0, row, out); }

  // The same for pixels centred at (column, row), (column + 1, row) ..., possibly fractional or outside the frame. A
  // still image is extended by its border pixels. Thread: any.
  virtual void sample_from(double t_s, double column, int row, std::span<float> out) const noexcept = 0;

  // Appends increasing instants in (from_s, to_s], the last one to_s. Between neighbours T_ss is quadratic in time, or
  // close enough that a pixel averaging over about `response_s` errs by less than kStepToleranceK. A jump is a pair of
  // adjacent doubles: the last instant before it, and its own. Thread: any.
  virtual void instants(double from_s, double to_s, double response_s, std::vector<double>& out) const = 0;

  virtual Extremes extremes() const = 0;

  // The field after a blur, if known in closed form; otherwise nullptr. Thread: setup.
  virtual std::unique_ptr<const Field> blurred(const Blur& /*blur*/) const { return nullptr; }

  // The `/stimulus` of this field from `from_s` to `to_s`. Thread: setup.
  virtual capture::Stimulus stimulus(double from_s, double to_s) const = 0;
};

inline constexpr double kStepToleranceK = 0.0005;

// Appends the ends of equal steps from `from_s` to `to_s`, at most `longest_s` each. Thread: any.
void divide(double from_s, double to_s, double longest_s, std::vector<double>& out);

// A flat black body or closed shutter.
std::unique_ptr<const Field> make_uniform(double temperature_k);

// The whole field switches between levels. on_s, off_s and level_k have equal length; pulses are ordered and disjoint.
std::unique_ptr<const Field> make_chopper(capture::Chopper chopper);

// Hot bars on cold. The bars cover phases [0, bar_width_px) of x - slant_px_per_row * row - velocity_px_s * t, modulo
// period_px; a pixel averages over its width, [x - 0.5, x + 0.5], along its middle line.
std::unique_ptr<const Field> make_bars(const capture::BarTarget& target);

// The field of a uniform, chopper or bar stimulus.
std::unique_ptr<const Field> make_field(const capture::Stimulus& stimulus);

// A still image panned along a path: pixel (0, 0) looks at image (x, y) = path.at(t), bilinear between pixel centres.
// The image must cover the path from `from_s` to `to_s`; outside these times the view stops at its borders.
std::unique_ptr<const Field> make_scene(capture::StillImage image, Path path, Geometry view);

// Makes a field of the part of the scene that a view of size `view` sees between the two times. `origin`: scene
// position of pixel (0, 0) for motion (0, 0). kBadInput when the path covers over kMaxCanvasPixels. Thread: setup.
Result<std::unique_ptr<const Field>> pan_over(const Scene& scene, const Path& motion, Position origin, Geometry view,
                                              double from_s, double to_s);

inline constexpr double kMaxCanvasPixels = 256e6;

// Origin that centres the path's view on the scene, rounded to whole pixels.
Position centred_origin(const Scene& scene, const Path& motion, Geometry view, double from_s, double to_s);

}  // namespace bolo::sim
