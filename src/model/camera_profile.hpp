// Properties of one camera, read from a TOML file (config/a655sc.toml documents every key).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/gyro.hpp"
#include "src/core/result.hpp"
#include "src/model/strict_toml.hpp"

namespace bolo::model {

// --- Effects of a camera on its frames beyond thermal inertia that can be corrected by constants (not maps). Each is a
// key of the camera's profile; src/corrections describes how it is undone, and its cost in noise.

// The camera's temporal filter: x read, y sent, w the new frame's weight.
enum class FrameFilter {
  kNone,
  kRecursive,  // y_k = w x_k + (1 - w) y_{k-1}
  kBox,        // y_k = w x_k + (1 - w) x_{k-1}
};

// The defaults undo nothing.
struct Undo {
  FrameFilter filter = FrameFilter::kNone;
  double filter_weight = 1.0;  // w
  double slow_share = 0.0;
  double slow_tau_s = 0.15;
  double coupling = 0.0;
  double integration_s = 0.0;
  bool radiance = false;
  double emissivity = 1.0;
  double reflected_k = 295.0;
  double ceiling_k = 0.0;
  double flicker_k = 0.0;
  bool follow_jumps = false;
  bool drop_repeated = false;
  bool scene_nuc = false;

  bool operator==(const Undo&) const = default;
};

// A value's key in a profile, and the effects of the catalogue whose parameter it is; "": the effect itself.
struct UndoKey {
  std::string_view section;
  std::string_view key;
  std::variant<double Undo::*, bool Undo::*, FrameFilter Undo::*> value;
  Range range;  // of a number
  std::vector<std::string_view> effects;
  std::string_view parameter;
  std::string_view meaning;
};

// In the order of the profile, section by section. Thread: any.
inline const std::vector<UndoKey>& undo_keys() {
  // clang-format off
  static const std::vector<UndoKey> kKeys{
      {"pixel", "slow_share", &Undo::slow_share, {0.0, 0.3, ""}, {"slow_pole"}, "share",
       "Share of the response that follows slow_tau_s: 1 / (1 + s tau) becomes (1 - share) / (1 + s tau) + share / "
       "(1 + s slow_tau)."},
      {"pixel", "slow_tau_s", &Undo::slow_tau_s, {0.02, 2.0, "s"}, {"slow_pole"}, "slow_tau_s",
       "Time constant of that share."},
      {"pixel", "coupling", &Undo::coupling, {0.0, 0.2, ""}, {"crosstalk"}, "coupling",
       "Heat that flows to each of a pixel's four neighbours, relative to the heat that flows to its substrate."},
      {"pixel", "integration_s", &Undo::integration_s, {0.0, 0.1, "s"}, {"integration_window"}, "window_s",
       "A frame is the mean of the pixels' values over this time before its own, so it is late by half of it."},
      {"radiometry", "radiance", &Undo::radiance, {}, {"radiometric_nonlinearity"}, "",
       "The pixels respond to radiance from 7.5 to 14 um (Planck); frames show its temperature."},
      {"radiometry", "emissivity", &Undo::emissivity, {0.3, 1.0, ""}, {"emissivity"}, "emissivity",
       "Emissivity of the object. Deblurred temperatures are its own, without its surroundings' reflection."},
      {"radiometry", "reflected_k", &Undo::reflected_k, {150.0, 600.0, "K"}, {"emissivity"}, "surroundings_k",
       "Temperature of the surroundings that it reflects."},
      {"radiometry", "ceiling_k", &Undo::ceiling_k, {0.0, 2000.0, "K"}, {"saturation"}, "level_k",
       "Frames with values from here on are flagged as saturated; 0: only values at the end of 16 bits."},
      {"firmware", "frame_filter", &Undo::filter, {}, {}, "",
       "Averaging of frames: recursive, with the frame sent before; box, with the frame read before."},
      {"firmware", "frame_filter_weight", &Undo::filter_weight, {0.05, 1.0, ""}, {}, "",
       "Weight of the new frame in it; above 0.5 for a box, whose inverse is unstable below."},
      {"firmware", "flicker_k", &Undo::flicker_k, {0.0, 5.0, "K"}, {"flicker"}, "sigma_k",
       "Random offset of each whole frame, root mean square; removed. 0: none."},
      {"firmware", "follow_jumps", &Undo::follow_jumps, {}, {"offset_jump"}, "",
       "Steps of all pixels by the same amount between two frames are the camera's: removed, forgotten within minutes."},
      {"firmware", "drop_repeated", &Undo::drop_repeated, {}, {"frame_loss", "nuc_freeze"}, "",
       "A frame that repeats the one before bit for bit counts as lost: the camera had no new one."},
      {"corrections", "scene_nuc", &Undo::scene_nuc, {}, {}, "",
       "Learn the fixed pattern that stays while the scene moves from the stream, and remove it (scene-based NUC)."},
  };
  // clang-format on
  return kKeys;
}

// Value of an effect's parameter; for parameter "" any number if the effect is present; otherwise empty.
using EffectValue = std::function<std::optional<double>(std::string_view effect, std::string_view parameter)>;

// Sets the corrections of effects known to `value_of` with a single parameter (not frame filters). Thread: any.
void undo_effects(Undo& undo, const EffectValue& value_of);

// Maps are row-major over the whole frame; an empty one means the nominal value everywhere. Corrections apply in this
// order: value -> gain * value + offset -> thermal inertia with the pixel's own tau_s. "Value" is a temperature in K,
// or counts for frames that have no kelvin.
struct PixelMaps {
  Geometry geometry;               // of the frames that the maps are for; 0x0: of the stream they are used with
  std::vector<float> tau_s;        // thermal time constant, s
  std::vector<float> gain;         // 1: unchanged
  std::vector<float> offset;       // in the unit of the frames: K, or counts where they have no kelvin
  std::vector<std::uint8_t> dead;  // 1: no signal; filled from its neighbours
  double row_delay_s = 0.0;        // sensor row r is sampled r * row_delay_s after the frame's time; s

  bool empty() const { return tau_s.empty() && gain.empty() && offset.empty() && dead.empty() && row_delay_s == 0.0; }
};

struct CameraProfile {
  std::string model = "FLIR A655sc";
  std::string serial;
  double tau_s = 0.011;  // thermal time constant of a pixel
  double frame_period_s = 0.005;
  double noise_k = 0.03;         // temporal noise, K rms
  double quantisation_k = 0.01;  // K a count
  double row_delay_s = 0.0;      // from the sample of one sensor row to that of the next
  std::filesystem::path maps;    // per-pixel parameters (capture/pixel_maps_io.hpp); empty: none
  GyroSetup gyro;                // parameters for a gyro beside the camera
  Undo undo;                     // other effects of the camera to undo

  // Frame transport: configurable because it was not proven on every camera.
  bool big_endian_pixels = false;  // Mono16 byte order on the wire
  int metadata_rows = 0;           // rows at the end of each frame that are not image
};

// Declares the keys of a profile, bound to `profile`, which must outlive the table. Thread: any.
KeyTable profile_keys(CameraProfile& profile);

// Reads a profile. Unknown keys, wrong types and values out of range are refused with file, line and the nearest valid
// key. Only the keys given replace the defaults. Thread: setup.
Result<CameraProfile> read_profile(const std::filesystem::path& file);

// Explanations by key: "measured, 95 % interval ...".
using Origins = std::map<std::string, std::string, std::less<>>;

// A complete commented profile of `profile`, numbers to seven digits; `origins`: where values come from. Thread: any.
std::string document_profile(CameraProfile profile, const Origins& origins = {});

// Keys of `after` whose text differs from `before`, each as "tau_s = 0.0121". Thread: any.
std::vector<std::string> changes(CameraProfile before, CameraProfile after);

}  // namespace bolo::model
