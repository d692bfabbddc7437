#include "src/model/camera_profile.hpp"

#include <algorithm>
#include <array>
#include <charconv>

namespace bolo::model {
namespace {

constexpr double kLeastBoxWeight = 0.5;
constexpr std::string_view kHeading =
    "# What is known of one camera. The first four keys are enough; every key may be left out.\n"
    "# Keys marked 'unproven' were read in documents and programs, not measured on this camera.\n\n";

constexpr std::array<std::pair<std::string_view, bool>, 2> kByteOrders{{{"little", false}, {"big", true}}};
constexpr std::array<std::pair<std::string_view, FrameFilter>, 3> kFilters{
    {{"none", FrameFilter::kNone}, {"recursive", FrameFilter::kRecursive}, {"box", FrameFilter::kBox}}};

constexpr std::array<std::pair<std::string_view, std::string_view>, 4> kUndoSections{
    {{"pixel", "response of the pixels, beyond tau_s"},
     {"radiometry", "from object temperature to frame values"},
     {"firmware", "processing of frames in the camera"},
     {"corrections", "learned from the stream and removed"}}};

// Keys that `bolo diagnose --write-profile` adds to the basic ones.
void declare(KeyTable& keys, const UndoKey& key, Undo& undo) {
  if (const auto* const number = std::get_if<double Undo::*>(&key.value)) {
    keys.number(key.key, undo.**number, key.range, key.meaning);
  } else if (const auto* const flag = std::get_if<bool Undo::*>(&key.value)) {
    keys.boolean(key.key, undo.**flag, key.meaning);
  } else {
    keys.choice<FrameFilter>(key.key, undo.*std::get<FrameFilter Undo::*>(key.value), kFilters, key.meaning);
  }
}

// Rounds to seven digits, more than measured values have: sums of products leave rounding errors.
void round_numbers(CameraProfile& profile) {
  const auto round = [](double& value) {
    std::array<char, 32> text{};
    const auto end = std::to_chars(text.begin(), text.end(), value, std::chars_format::scientific, 6).ptr;
    std::from_chars(text.begin(), end, value);
  };
  for (double* value :
       {&profile.tau_s, &profile.frame_period_s, &profile.noise_k, &profile.quantisation_k, &profile.row_delay_s}) {
    round(*value);
  }
  for (const UndoKey& key : undo_keys()) {
    if (const auto* const number = std::get_if<double Undo::*>(&key.value)) round(profile.undo.**number);
  }
}

}  // namespace

KeyTable profile_keys(CameraProfile& profile) {
  KeyTable keys;
  keys.number("tau_s", profile.tau_s, {1e-4, 1.0, "s"},
              "Thermal time constant of a pixel: tau of tau dy/dt + y = x. The paper measured 11 ms for the A655sc.");
  keys.number("frame_period_s", profile.frame_period_s, {1e-4, 10.0, "s"},
              "Time between frames; 0.005 is the A655sc's 200 Hz at 640x120.");
  keys.number("noise_k", profile.noise_k, {0.0, 100.0, "K"}, "Temporal noise of one pixel, root mean square.");
  keys.number("quantisation_k", profile.quantisation_k, {0.0, 100.0, "K"},
              "Temperature step of one count; 0.01 in TemperatureLinear10mK.");
  keys.number(
      "row_delay_s", profile.row_delay_s, {-1e-2, 1e-2, "s"},
      "Rolling read-out: from one sensor row's sample to the next row's. All rows are published at row 0's time.");
  keys.file("maps", profile.maps, "a655sc-maps.h5",
            "HDF5 file of per-pixel parameters: tau_s, gain, offset_k, dead. Left out: none.");
  keys.section("camera", "identity of the camera");
  keys.text("model", profile.model, "Model, for information.");
  keys.text("serial", profile.serial, "Serial number; the log warns of a camera with another one. Empty: any.");
  keys.section("transport", "format of the camera's frames");
  keys.choice<bool>("byte_order", profile.big_endian_pixels, kByteOrders,
                    "Byte order of Mono16 pixels on the wire. Unproven: other FLIR models send big-endian.");
  keys.integer("metadata_rows", profile.metadata_rows, {0, 64, "rows"},
               "Metadata rows at the end of each frame. Unproven: some firmware sends 3.");
  constexpr Range kPixels{-1e4, 1e4, "pixels"};
  keys.section("lens", "lens, for converting a gyro's rates to image motion");
  keys.number("focal_px", profile.gyro.focal_px, {0.0, 1e5, "pixels"},
              "Focal length: (width / 2) / tan(half the horizontal field of view). 0: not known.");
  keys.number("principal_x_px", profile.gyro.principal_x_px, kPixels, "Principal point, right of the frame's centre.");
  keys.number("principal_y_px", profile.gyro.principal_y_px, kPixels, "Principal point, below the frame's centre.");
  keys.section("gyro", "a gyro beside the camera: bolod's [motion] gyro, bolo deblur --gyro");
  keys.number("delay_s", profile.gyro.delay_s, {-1.0, 1.0, "s"},
              "Delay of a sample's time stamp against that of a simultaneous frame.");
  for (const auto& [section, meaning] : kUndoSections) {
    keys.section(section, meaning);
    for (const UndoKey& key : undo_keys()) {
      if (key.section == section) declare(keys, key, profile.undo);
    }
  }
  return keys;
}

Result<CameraProfile> read_profile(const std::filesystem::path& file) {
  CameraProfile profile;
  KeyTable keys = profile_keys(profile);
  RETURN_IF_ERROR(keys.read(file));
  if (profile.undo.filter == FrameFilter::kBox && profile.undo.filter_weight <= kLeastBoxWeight) {
    return bad_input(keys.where("firmware.frame_filter_weight") + "frame_filter_weight of a box must be above 0.5: " +
                     "with less, what is undone grows without end");
  }
  return profile;
}

void undo_effects(Undo& undo, const EffectValue& value_of) {
  for (const UndoKey& key : undo_keys()) {
    for (const std::string_view effect : key.effects) {
      const std::optional<double> value = value_of(effect, key.parameter);
      if (!value) continue;
      if (const auto* const number = std::get_if<double Undo::*>(&key.value)) {
        undo.** number = std::clamp(*value, key.range.min, key.range.max);
      } else if (const auto* const flag = std::get_if<bool Undo::*>(&key.value)) {
        undo.** flag = true;
      }
    }
  }
}

std::string document_profile(CameraProfile profile, const Origins& origins) {
  round_numbers(profile);
  KeyTable keys = profile_keys(profile);
  CameraProfile nominal;
  const auto defaults = profile_keys(nominal).texts();
  for (const auto& [path, value] : keys.texts()) {
    const std::string& usual = defaults.at(path);
    if (value != usual) keys.explain(path, usual.empty() ? "no default" : "default " + usual);
  }
  for (const auto& [path, words] : origins) keys.explain(path, words);
  return std::string(kHeading) + keys.document();
}

std::vector<std::string> changes(CameraProfile before, CameraProfile after) {
  round_numbers(before);
  round_numbers(after);
  const auto old = profile_keys(before).texts();
  std::vector<std::string> list;
  for (const auto& [path, value] : profile_keys(after).texts()) {
    if (value != old.at(path)) list.push_back(path + " = " + (value.empty() ? "none" : value));
  }
  return list;
}

}  // namespace bolo::model
