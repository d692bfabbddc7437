// Converts a camera's status between the pipeline, shared memory and JSON.
#pragma once

#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include "bolo/shm_layout.h"
#include "src/pipeline/source.hpp"

namespace bolo::shm {

// Builds the text of a JSON object member by member. The JSON library's trees allocate in their destructors, and
// terminate the process when that fails: a daemon must not use them. Thread: any, one at a time.
class JsonMembers {
 public:
  // A number, text, truth or null. The key is written without escaping.
  void add(std::string_view key, const nlohmann::json& leaf) { add_text(key, leaf.dump()); }
  // Adds a value that is already JSON.
  void add_text(std::string_view key, const std::string& json) {
    members_.append(members_.empty() ? "\"" : ",\"").append(key).append("\":").append(json);
  }
  std::string text() const { return "{" + members_ + "}"; }

 private:
  std::string members_;
};

// Omits the control socket's path. Thread: any.
bolo_shm_camera camera_block(const pipeline::SourceStatus& status) noexcept;

// "streaming", "lost" ...; "unknown" for a state of a later version. Thread: any.
const char* camera_state_word(const bolo_shm_camera& camera) noexcept;

// State of the camera's PTP clock: "off", "slave" ...; "unknown" for one of a later version. Thread: any.
const char* ptp_word(const bolo_shm_camera& camera) noexcept;

// Seconds from one CLOCK_MONOTONIC time to another, at least 0; safe for any values. Thread: any.
double seconds_since(std::int64_t then_ns, std::int64_t now_ns) noexcept;

// Keys in snake_case with units; unknown values are null. now_ns: CLOCK_MONOTONIC. Thread: any.
std::string camera_json(const bolo_shm_camera& camera, std::int64_t now_ns);

}  // namespace bolo::shm
