#include "tools/bolod/config_camera.hpp"

#include <arpa/inet.h>

#include <array>
#include <string_view>
#include <utility>

namespace bolo::daemon {
namespace {

using genicam::NucPolicy;

constexpr std::array<std::pair<std::string_view, NucPolicy>, 4> kPolicies{{{"camera", NucPolicy::kCamera},
                                                                           {"manual", NucPolicy::kManual},
                                                                           {"timed", NucPolicy::kTimed},
                                                                           {"still", NucPolicy::kStill}}};
constexpr double kHottestK = 5000.0;

void nuc_keys(model::KeyTable& keys, genicam::NucOptions& nuc) {
  keys.section("nuc", "when the camera closes its shutter and corrects its pixels (NUC)");
  keys.choice<NucPolicy>(
      "policy", nuc.policy, kPolicies,
      "camera: it decides itself, unseen. manual: only by `bolo nuc`. timed: at the interval. still: "
      "when the scene stands still, at least the interval apart.");
  keys.number("interval_s", nuc.interval_s, {1.0, 86400.0, "s"}, "From one to the next.");
  keys.number("still_s", nuc.still_s, {0.2, 3600.0, "s"}, "How long nothing may have moved.");
  keys.number("still_k", nuc.still_k, {0.001, 1000.0, "K (counts when the source has no kelvin)"},
              "A change of the pixels by less than this from one tenth of a second to the next, on average, is none; "
              "noise of s changes them by 1.13 s.");
  keys.integer(
      "hold_ms", nuc.hold_ms, {0, 60000, "ms"},
      "Frames of this time after the command are taken for the shutter's. Unproven: whether the camera repeats "
      "frames meanwhile, or sends none, and for how long.");
}

void object_keys(model::KeyTable& keys, genicam::ObjectParameters& object) {
  constexpr double kRoomK = 293.15;
  keys.section("object", "what the camera reckons with; unity gives temperatures of black bodies. Left out: as it has");
  keys.number("emissivity", object.emissivity, {0.01, 1.0, ""}, "Of what is looked at.");
  keys.number("transmission", object.transmission, {0.01, 1.0, ""}, "Of the air (EstimatedTransmission).");
  keys.number("optics_transmission", object.optics_transmission, {0.01, 1.0, ""}, "Of a window before the lens.");
  keys.number("reflected_k", object.reflected_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature that it reflects.");
  keys.number("atmosphere_k", object.atmosphere_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature of the air.");
  keys.number("optics_k", object.optics_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature of that window.");
  keys.number("distance_m", object.distance_m, 1.0, {0.0, 1e5, "m"}, "Distance of the object.");
  keys.number("humidity", object.humidity, 0.5, {0.0, 1.0, ""}, "Relative humidity of the air.");
}

}  // namespace

void camera_keys(model::KeyTable& keys, genicam::CameraOptions& camera) {
  keys.section("camera", "what it measures");
  keys.number("range_low_k", camera.range_low_k, {0.0, kHottestK, "K"},
              "With range_high_k: the narrowest of the camera's ranges that holds both is chosen.");
  keys.number("range_high_k", camera.range_high_k, {0.0, kHottestK, "K"}, "0: the camera's range is left.");
  nuc_keys(keys, camera.nuc);
  object_keys(keys, camera.object);
}

Status check_camera(const genicam::CameraOptions& camera) {
  if (camera.range_high_k > 0.0 && camera.range_low_k >= camera.range_high_k) {
    return bad_input("camera.range_low_k must be below camera.range_high_k");
  }
  return {};
}

Status check_address(const std::string& address) {
  in_addr parsed{};
  if (address.empty() || address.find_first_not_of("0123456789.") != std::string::npos) return {};
  if (inet_pton(AF_INET, address.c_str(), &parsed) == 1) return {};
  return bad_input("source.address = \"" + address + "\" is no IPv4 address such as 192.168.2.5");
}

}  // namespace bolo::daemon
