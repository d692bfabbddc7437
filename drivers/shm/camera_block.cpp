#include "drivers/shm/camera_block.hpp"

#include <algorithm>
#include <string>

namespace bolo::shm {
namespace {

using nlohmann::ordered_json;
using pipeline::kLostCauses;
using pipeline::LostCause;
using pipeline::SourceState;

static_assert(static_cast<std::uint64_t>(SourceState::kIdle) == BOLO_CAMERA_IDLE);
static_assert(static_cast<std::uint64_t>(SourceState::kStreaming) == BOLO_CAMERA_STREAMING);
static_assert(static_cast<std::uint64_t>(SourceState::kStalled) == BOLO_CAMERA_STALLED);
static_assert(static_cast<std::uint64_t>(SourceState::kLost) == BOLO_CAMERA_LOST);
static_assert(static_cast<std::uint64_t>(SourceState::kCorrecting) == BOLO_CAMERA_CORRECTING);
static_assert(kLostCauses <= BOLO_SHM_LOST_CAUSES);

// "control lost" -> "control_lost"
std::string key_of(LostCause cause) {
  std::string key(name(cause));
  std::replace(key.begin(), key.end(), ' ', '_');
  return key;
}

}  // namespace

// The difference itself may be beyond what 64 bits hold with a sign.
double seconds_since(std::int64_t then_ns, std::int64_t now_ns) noexcept {
  if (then_ns >= now_ns) return 0.0;
  return static_cast<double>(static_cast<std::uint64_t>(now_ns) - static_cast<std::uint64_t>(then_ns)) * 1e-9;
}

bolo_shm_camera camera_block(const pipeline::SourceStatus& status) noexcept {
  bolo_shm_camera block{};
  block.bytes = sizeof(block);
  block.state = static_cast<std::uint64_t>(status.state.value());
  block.since_ns = status.since_ns.value();
  for (std::size_t i = 0; i < kLostCauses; ++i) block.lost[i] = status.lost[i].value();
  block.reopened = status.reopened.value();
  block.stalls = status.stalls.value();
  block.outage_frames = status.outage_frames.value();
  block.corrections = status.corrections.value();
  block.correction_ns = status.correction_ns.value();
  block.clock_offset_ns = status.clock_offset_ns.value();
  block.clock_drift_ppm = status.clock_drift_ppm.value();
  block.clock_jitter_ns = status.clock_jitter_ns.value();
  block.clock_jumps = status.clock_jumps.value();
  block.received_packets = status.received_packets.value();
  block.missing_packets = status.missing_packets.value();
  block.resent_packets = status.resent_packets.value();
  block.temperature_k = status.temperature_k.value();
  return block;
}

const char* camera_state_word(const bolo_shm_camera& camera) noexcept {
  // The names are literals, and so end with a zero.
  return camera.state < pipeline::kSourceStates ? name(static_cast<SourceState>(camera.state)).data() : "unknown";
}

ordered_json camera_json(const bolo_shm_camera& camera, std::int64_t now_ns) {
  ordered_json json{{"state", camera_state_word(camera)},
                    {"state_age_s", seconds_since(camera.since_ns, now_ns)},
                    {"reopened", camera.reopened},
                    {"stalls", camera.stalls},
                    {"outage_frames", camera.outage_frames},
                    {"nucs", camera.corrections},
                    {"nuc_age_s", nullptr},
                    {"clock_offset_s", nullptr},
                    {"clock_drift_ppm", nullptr},
                    {"clock_jitter_ms", nullptr},
                    {"clock_jumps", camera.clock_jumps},
                    {"received_packets", camera.received_packets},
                    {"missing_packets", camera.missing_packets},
                    {"resent_packets", camera.resent_packets},
                    {"temperature_k", nullptr}};
  for (std::size_t i = 0; i < kLostCauses; ++i) json["lost"][key_of(static_cast<LostCause>(i))] = camera.lost[i];
  if (camera.correction_ns != 0) json["nuc_age_s"] = seconds_since(camera.correction_ns, now_ns);
  if (camera.temperature_k > 0.0) json["temperature_k"] = camera.temperature_k;
  if (camera.clock_offset_ns != 0) {
    json["clock_offset_s"] = static_cast<double>(camera.clock_offset_ns) * 1e-9;
    json["clock_drift_ppm"] = camera.clock_drift_ppm;
    json["clock_jitter_ms"] = camera.clock_jitter_ns * 1e-6;
  }
  return json;
}

}  // namespace bolo::shm
