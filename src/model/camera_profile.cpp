#include "src/model/camera_profile.hpp"

#include <array>

namespace bolo::model {
namespace {

constexpr double kLeastBoxWeight = 0.5;
constexpr std::string_view kHeading =
    "# What is known of one camera. The first four keys are enough; every key may be left out.\n"
    "# Keys marked 'unproven' were read in documents and programs, not measured on this camera.\n\n";

constexpr std::array<std::pair<std::string_view, bool>, 2> kByteOrders{{{"little", false}, {"big", true}}};
constexpr std::array<std::pair<std::string_view, FrameFilter>, 3> kFilters{
    {{"none", FrameFilter::kNone}, {"recursive", FrameFilter::kRecursive}, {"box", FrameFilter::kBox}}};

// What `bolo diagnose --write-profile` finds beyond the first keys.
void declare_undo(KeyTable& keys, Undo& undo) {
  keys.section("pixel", "how the pixels answer, beyond tau_s");
  keys.number(
      "slow_share", undo.slow_share, {0.0, 0.3, ""},
      "Share of the answer that follows slow_tau_s: 1 / (1 + s tau) becomes (1 - share) / (1 + s tau) + share / "
      "(1 + s slow_tau).");
  keys.number("slow_tau_s", undo.slow_tau_s, {0.02, 2.0, "s"}, "Time constant of that share.");
  keys.number("coupling", undo.coupling, {0.0, 0.2, ""},
              "Heat that flows to each of a pixel's four neighbours, in units of what flows to its substrate.");
  keys.number("integration_s", undo.integration_s, {0.0, 0.1, "s"},
              "A frame is the mean of what the pixels show over this time before its own: it is half of it late.");
  keys.section("radiometry", "from what is looked at to what the frames show");
  keys.boolean("radiance", undo.radiance,
               "The pixels follow the radiance from 7.5 to 14 um (Planck), the frames show its temperature.");
  keys.number("emissivity", undo.emissivity, {0.3, 1.0, ""},
              "Of what is looked at. Deblurred temperatures are its own, not mixed with its surroundings'.");
  keys.number("reflected_k", undo.reflected_k, {150.0, 600.0, "K"},
              "Temperature of the surroundings that it reflects.");
  keys.number("ceiling_k", undo.ceiling_k, {0.0, 2000.0, "K"},
              "Frames with values from here on up are flagged as saturated; 0: only those at the end of 16 bits.");
  keys.section("firmware", "what the camera does to its frames");
  keys.choice<FrameFilter>("frame_filter", undo.filter, kFilters,
                           "How frames are averaged: recursive, with the frame sent before; box, with the frame read "
                           "before.");
  keys.number("frame_filter_weight", undo.filter_weight, {0.05, 1.0, ""},
              "Weight of the new frame in it; above 0.5 for a box, whose undoing is not stable below.");
  keys.number("flicker_k", undo.flicker_k, {0.0, 5.0, "K"},
              "An offset that the whole frame has anew every time, root mean square; it is taken out. 0: none.");
  keys.boolean("follow_jumps", undo.follow_jumps,
               "Steps of all pixels by the same amount, from one frame to the next, are the camera's: taken out.");
  keys.boolean("drop_repeated", undo.drop_repeated,
               "A frame that repeats the one before bit for bit counts as lost: the camera had none, or was busy.");
}

}  // namespace

KeyTable profile_keys(CameraProfile& profile) {
  KeyTable keys;
  keys.number("tau_s", profile.tau_s, {1e-4, 1.0, "s"},
              "Thermal time constant of a pixel: tau of tau dy/dt + y = x. The paper measured 11 ms for the A655sc.");
  keys.number("frame_period_s", profile.frame_period_s, {1e-4, 10.0, "s"},
              "Time from frame to frame; 0.005 is the A655sc's 200 Hz at 640x120.");
  keys.number("noise_k", profile.noise_k, {0.0, 100.0, "K"}, "Temporal noise of one pixel, root mean square.");
  keys.number("quantisation_k", profile.quantisation_k, {0.0, 100.0, "K"},
              "Temperature step of one count; 0.01 in TemperatureLinear10mK.");
  keys.number(
      "row_delay_s", profile.row_delay_s, {-1e-2, 1e-2, "s"},
      "Rolling read-out: from one sensor row's sample to the next row's. All rows are published at row 0's time.");
  keys.file("maps", profile.maps, "a655sc-maps.h5",
            "HDF5 file with parameters of single pixels: tau_s, gain, offset_k, dead. Left out: none.");
  keys.section("camera", "which camera this is");
  keys.text("model", profile.model, "Model, for people.");
  keys.text("serial", profile.serial, "Serial number; a camera with another one is told in the log. Empty: any.");
  keys.section("transport", "how the camera sends its frames");
  keys.choice<bool>("byte_order", profile.big_endian_pixels, kByteOrders,
                    "Byte order of Mono16 pixels on the wire. Unproven: other FLIR models send big-endian.");
  keys.integer("metadata_rows", profile.metadata_rows, {0, 64, "rows"},
               "Rows at the end of each frame that are not image. Unproven: some firmware sends 3.");
  declare_undo(keys, profile.undo);
  return keys;
}

Result<CameraProfile> read_profile(const std::filesystem::path& file) {
  CameraProfile profile;
  KeyTable keys = profile_keys(profile);
  if (Status status = keys.read(file); !status) return tl::unexpected<Error>(status.error());
  if (profile.undo.filter == FrameFilter::kBox && profile.undo.filter_weight <= kLeastBoxWeight) {
    return bad_input(keys.where("firmware.frame_filter_weight") + "frame_filter_weight of a box must be above 0.5: " +
                     "with less, what is undone grows without end");
  }
  return profile;
}

std::string document_profile(CameraProfile profile) { return std::string(kHeading) + profile_keys(profile).document(); }

}  // namespace bolo::model
