// The scene before the camera during a capture: the `/stimulus` group. Times in s from /t[0], temperatures in K,
// lengths in stored pixels.
#pragma once

#include <variant>
#include <vector>

namespace bolo::capture {

struct NoStimulus {};  // a field recording

struct Uniform {  // closed shutter or flat black body
  double temperature_k = 0.0;
};

struct Chopper {  // the whole field is at level_k[i] from on_s[i] to off_s[i], at cold_k otherwise
  double cold_k = 0.0;
  std::vector<double> on_s;
  std::vector<double> off_s;
  std::vector<double> level_k;
};

struct BarTarget {  // hot bars on cold, moving along +x; velocity 0 is a static target
  double cold_k = 0.0;
  double hot_k = 0.0;
  double period_px = 0.0;
  double bar_width_px = 0.0;
  double slant_px_per_row = 0.0;
  double velocity_px_s = 0.0;
};

struct SceneStimulus {  // a still panned along a trajectory: the frame's pixel (0, 0) looks at image (x_px, y_px)
  int image_width = 0;
  int image_height = 0;
  std::vector<float> image_k;  // row-major
  std::vector<double> t_s;
  std::vector<double> x_px;
  std::vector<double> y_px;
};

using Stimulus = std::variant<NoStimulus, Uniform, Chopper, BarTarget, SceneStimulus>;

}  // namespace bolo::capture
