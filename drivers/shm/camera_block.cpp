#include "drivers/shm/camera_block.hpp"

#include <array>
#include <bit>

namespace bolo::shm {
namespace {

using pipeline::kCameraCounters;
using pipeline::kLostCauses;
using pipeline::SourceState;

static_assert(static_cast<std::uint64_t>(SourceState::kIdle) == BOLO_CAMERA_IDLE);
static_assert(static_cast<std::uint64_t>(SourceState::kStreaming) == BOLO_CAMERA_STREAMING);
static_assert(static_cast<std::uint64_t>(SourceState::kStalled) == BOLO_CAMERA_STALLED);
static_assert(static_cast<std::uint64_t>(SourceState::kLost) == BOLO_CAMERA_LOST);
static_assert(static_cast<std::uint64_t>(SourceState::kCorrecting) == BOLO_CAMERA_CORRECTING);
static_assert(static_cast<std::uint64_t>(pipeline::PtpStatus::kSlave) == 9, "as shm_layout.h says");
static_assert(kLostCauses <= BOLO_SHM_LOST_CAUSES);

using Words = std::array<std::uint64_t, sizeof(bolo_shm_camera) / sizeof(std::uint64_t)>;

nlohmann::json value_of(const pipeline::CounterRow<pipeline::SourceStatus>& row, const Words& words,
                        std::int64_t now_ns) {
  using pipeline::RowKind;
  const auto word = [&words](std::size_t offset) { return words[offset / sizeof(std::uint64_t)]; };
  const std::uint64_t own = word(row.shared);
  if (row.kind == RowKind::kCount) return own;
  if (word(row.known_by != 0 ? row.known_by : row.shared) == 0) return nullptr;
  if (row.kind == RowKind::kSince) return seconds_since(static_cast<std::int64_t>(own), now_ns);
  if (row.kind == RowKind::kReal) return std::bit_cast<double>(own) * row.json_scale;
  return static_cast<double>(static_cast<std::int64_t>(own)) * row.json_scale;
}

}  // namespace

// Unsigned, because a signed difference may overflow.
double seconds_since(std::int64_t then_ns, std::int64_t now_ns) noexcept {
  if (then_ns >= now_ns) return 0.0;
  return static_cast<double>(static_cast<std::uint64_t>(now_ns) - static_cast<std::uint64_t>(then_ns)) * 1e-9;
}

bolo_shm_camera camera_block(const pipeline::SourceStatus& status) noexcept {
  Words words{};
  each_shared_word(kCameraCounters, status, [&words](std::size_t at, std::uint64_t word) { words[at] = word; });
  auto block = std::bit_cast<bolo_shm_camera>(words);
  block.bytes = sizeof(block);
  return block;
}

const char* camera_state_word(const bolo_shm_camera& camera) noexcept {
  // The names are string literals, hence zero-terminated.
  return camera.state < pipeline::kSourceStates ? name(static_cast<SourceState>(camera.state)).data() : "unknown";
}

const char* ptp_word(const bolo_shm_camera& camera) noexcept {
  return camera.ptp < pipeline::kPtpStatuses ? name(static_cast<pipeline::PtpStatus>(camera.ptp)).data() : "unknown";
}

std::string camera_json(const bolo_shm_camera& camera, std::int64_t now_ns) {
  const auto words = std::bit_cast<Words>(camera);
  JsonMembers json;
  json.add("state", camera_state_word(camera));
  json.add("state_age_s", seconds_since(camera.since_ns, now_ns));
  for (const auto& row : kCameraCounters) {
    if (!row.key.empty() && row.parts == 1) json.add(row.key, value_of(row, words, now_ns));
  }
  json.add("ptp", camera.ptp == 0 ? nlohmann::json() : nlohmann::json(ptp_word(camera)));
  for (const auto& row : kCameraCounters) {
    if (row.parts == 1) continue;
    JsonMembers parts;
    for (std::size_t i = 0; i < row.parts; ++i) {
      parts.add(part_key(row, i), words[row.shared / sizeof(std::uint64_t) + i]);
    }
    json.add_text(row.key, parts.text());
  }
  return json.text();
}

}  // namespace bolo::shm
