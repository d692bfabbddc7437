#include "tools/view/stat_sample.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include "drivers/shm/camera_block.hpp"
#include "src/core/text.hpp"
#include "src/pipeline/stats.hpp"
#include "src/rt/counters.hpp"

namespace bolo::tools {
namespace {

using Latency = std::array<std::uint64_t, BOLO_SHM_LATENCY_BUCKETS>;

double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

// Counters only rise; a negative difference comes from a torn snapshot and counts as zero.
std::uint64_t rise(std::uint64_t before, std::uint64_t after) { return after > before ? after - before : 0; }

// In another time namespace (container) a daemon's heartbeat has any age, but still advances.
const char* state_word(const StatSnapshot& before, const StatSnapshot& snapshot) {
  if (snapshot.header.state == BOLO_SHM_CLOSED) return "closed";
  const bool beats = before.closed && before.header.heartbeat_ns != snapshot.header.heartbeat_ns;
  if (snapshot.closed && !beats) return "stopped";
  return snapshot.header.state == BOLO_SHM_RUNNING ? "running" : "starting";
}

Latency latency_between(const bolo_shm_header& before, const bolo_shm_header& after) {
  Latency counts{};
  for (std::size_t b = 0; b < counts.size(); ++b) counts[b] = rise(before.latency[b], after.latency[b]);
  return counts;
}

template <typename... Values>
std::string line(fmt::format_string<Values...> format, Values&&... values) {
  return printable(fmt::format(format, std::forward<Values>(values)...)) + "\n";
}

std::string duration(double s) {
  const auto whole = static_cast<long long>(s);
  if (whole < 60) return fmt::format("{:.1f} s", s);
  return fmt::format("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60);
}

std::string describe_losses(const bolo_shm_camera& camera) {
  std::string words;
  for (std::size_t i = 0; i < pipeline::kLostCauses; ++i) {
    if (camera.lost[i] == 0) continue;
    words += fmt::format("{}{} {}", words.empty() ? " (" : ", ", camera.lost[i],
                         pipeline::name(static_cast<pipeline::LostCause>(i)));
  }
  return words.empty() ? words : words + ")";
}

template <typename Shared, typename Row>
std::uint64_t shared_count(const Shared& block, const Row& row) {
  std::uint64_t count = 0;
  std::memcpy(&count, reinterpret_cast<const char*>(&block) + row.shared, sizeof count);
  return count;
}

// A value in the daemon's answer, such as "/effort/now"; null if a daemon of another version lacks it.
nlohmann::ordered_json answered(const nlohmann::ordered_json& status, const std::string& path) {
  const nlohmann::ordered_json::json_pointer place(path);
  return status.contains(place) ? status.at(place) : nullptr;
}

double number_in(const nlohmann::ordered_json& answer) { return answer.is_number() ? answer.get<double>() : 0.0; }

std::uint64_t count_of(const nlohmann::ordered_json& answer) {
  return answer.is_number_unsigned() ? answer.get<std::uint64_t>() : 0;
}

// A count from shared memory, or else from the daemon's answer.
std::uint64_t frame_count(const StatSnapshot& snapshot, const pipeline::FrameRow& row) {
  if (row.shared != 0) return shared_count(snapshot.header, row);
  return count_of(answered(snapshot.status, "/" + std::string(row.key)));
}

// "16 warm-up, 3 with gaps".
template <typename Rows, typename CountOf>
std::string describe_counts(const Rows& rows, const CountOf& count_of) {
  std::string text;
  for (const auto& row : rows) {
    if (row.words.empty()) continue;
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count_of(row), row.words);
  }
  return text;
}

// State of the host's clock, according to its kernel.
std::string describe_clock(const bolo_shm_header& h) {
  std::string words = "host's clock runs by itself, error not known";
  if (h.clock_synchronised != 0) {
    words = fmt::format("host's clock synchronised, to {:.3g} ms", static_cast<double>(h.clock_error_ns) * 1e-6);
  }
  return h.clock_steps == 0 ? words : words + fmt::format("; set {} times", h.clock_steps);
}

std::string describe_gap(const nlohmann::ordered_json& status) {
  const auto times = [&status](const char* path) {
    const auto found = answered(status, path);
    return found.is_number() ? fmt::format("{:.2f}", found.get<double>()) : "?";
  };
  return fmt::format("foretells frames to {} x noise; time constant {} x, noise {} x the profile's",
                     times("/gap_ratio"), times("/gap_tau_ratio"), times("/gap_noise_ratio"));
}

// State of the camera, its clock and its corrections, as far as known.
std::string camera_lines(const bolo_shm_camera& camera, std::int64_t now_ns) {
  std::uint64_t lost = 0;
  for (const std::uint64_t count : camera.lost) lost += count;
  std::string out = line("link     {} for {}; lost {}{}, stalled {}; {} frames missed", shm::camera_state_word(camera),
                         duration(shm::seconds_since(camera.since_ns, now_ns)), lost, describe_losses(camera),
                         camera.stalls, camera.outage_frames);
  const auto packets = [&camera](const auto& row) { return shared_count(camera, row); };
  out += line("packets  {}", describe_counts(pipeline::kCameraCounters, packets));
  if (camera.clock_offset_ns != 0) {
    out += line("clock    drift {:+.1f} ppm, jitter {:.3f} ms, {} jumps", camera.clock_drift_ppm,
                camera.clock_jitter_ns * 1e-6, camera.clock_jumps);
  }
  if (camera.ptp != 0) out += line("ptp      {}, {} ns from its master", shm::ptp_word(camera), camera.ptp_offset_ns);
  if (camera.correction_ns != 0) {
    out += line("nuc      {}, the last {} ago", camera.corrections,
                duration(shm::seconds_since(camera.correction_ns, now_ns)));
  }
  if (camera.temperature_k > 0.0) out += line("inside   {:.1f} K", camera.temperature_k);
  return out;
}

}  // namespace

std::optional<StatMotion> newest_motion(const shm::ShmReader& reader) {
  if (reader.published() == 0) return std::nullopt;
  const auto frame = reader.borrow(reader.published() - 1);
  if (!frame || frame->motion() == nullptr) return std::nullopt;
  const bolo_shm_block_motion* const blocks = frame->motion_blocks();
  const std::size_t count = frame->layout.motion_blocks;
  const auto sure = std::count_if(blocks, blocks + count, [](const auto& block) { return block.confidence >= 0.5F; });
  const StatMotion motion{frame->motion()->affine[0], frame->motion()->affine[3],
                          static_cast<double>(sure) / static_cast<double>(count)};
  return frame->still_there() ? std::optional(motion) : std::nullopt;
}

StatSample compare(const StatSnapshot& before, const StatSnapshot& after) {
  const bolo_shm_header& a = before.header;
  const bolo_shm_header& b = after.header;
  StatSample s;
  s.interval_s = seconds(after.at_ns - before.at_ns);
  const double per_s = s.interval_s > 0.0 ? 1.0 / s.interval_s : 0.0;
  s.received_hz = static_cast<double>(rise(a.received, b.received)) * per_s;
  s.published_hz = static_cast<double>(rise(a.published, b.published)) * per_s;
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    s.lost[i] = b.lost[i];
    s.lost_hz[i] = static_cast<double>(rise(a.lost[i], b.lost[i])) * per_s;
    s.lost_total += b.lost[i];
  }
  const Latency latency = latency_between(a, b);
  for (const std::uint64_t count : latency) s.latency_frames += count;
  s.latency_p50_ms = rt::LatencyHistogram::percentile_ms(latency, 0.5);
  s.latency_p99_ms = rt::LatencyHistogram::percentile_ms(latency, 0.99);
  s.latency_max_ms = rt::LatencyHistogram::percentile_ms(latency, 1.0);
  const std::uint64_t solved = rise(rise(a.warm_up, b.warm_up), rise(a.published, b.published));
  if (solved > 0)
    s.deblur_ms = static_cast<double>(rise(a.deblur_ns, b.deblur_ns)) * 1e-6 / static_cast<double>(solved);
  s.uptime_s = shm::seconds_since(b.start_ns, after.at_ns);
  s.heartbeat_age_s = shm::seconds_since(static_cast<std::int64_t>(b.heartbeat_ns), after.at_ns);
  s.state = state_word(before, after);
  return s;
}

std::string stat_table(const std::string& name, const StatSnapshot& snapshot, const StatSample& s) {
  const bolo_shm_header& h = snapshot.header;
  std::string out = line("{}  {}, process {}, up {}, heartbeat {:.1f} s ago", name, s.state, h.writer_pid,
                         duration(s.uptime_s), s.heartbeat_age_s);
  out += line("camera   {} {}, {}x{} at {:.4g} Hz, tau {:.4g} ms", h.camera_model, h.camera_serial, h.width, h.height,
              h.frame_period_s > 0.0 ? 1.0 / h.frame_period_s : 0.0, h.tau_s * 1e3);
  if (snapshot.camera && snapshot.camera->state != BOLO_CAMERA_IDLE)
    out += camera_lines(*snapshot.camera, snapshot.at_ns);
  out += line("utc      {}", describe_clock(h));
  out += line("solver   {}", h.solver);
  out += line("window   {} frames, look-ahead {}; ring of {} slots", h.window, h.lookahead, h.slot_count);
  if (snapshot.motion) {
    out += line("motion   {:.2f} px a frame (x {:+.2f}, y {:+.2f}), {:.0f} % of the blocks sure",
                std::hypot(snapshot.motion->x_px, snapshot.motion->y_px), snapshot.motion->x_px, snapshot.motion->y_px,
                100.0 * snapshot.motion->sure);
  } else if (h.motion_offset != 0) {
    out += line("motion   not known for the newest frame");
  }
  out += line("frames   in {:9.1f} /s {:12}    out {:9.1f} /s {:12}", s.received_hz, h.received, s.published_hz,
              h.published);
  out += line("latency  p50 {:.3f}, p99 {:.3f}, max {:.3f} ms    deblur {:.3f} ms a frame", s.latency_p50_ms,
              s.latency_p99_ms, s.latency_max_ms, s.deblur_ms);
  if (snapshot.status.contains("stages")) {
    std::string stages;
    for (const auto& stage : pipeline::kStages) {
      stages += fmt::format("{}{} {:.3f}", stages.empty() ? "" : ", ", stage.name,
                            number_in(answered(snapshot.status, fmt::format("/stages/{}/p50_ms", stage.name))));
    }
    out += line("stages   {} ms (p50 of all)", stages);
  }
  if (snapshot.status.contains("effort")) {
    const auto now = answered(snapshot.status, "/effort/now");
    const auto frames = [&](const char* effort) {
      return count_of(answered(snapshot.status, fmt::format("/effort/frames/{}", effort)));
    };
    out +=
        line("effort   {}; {} frames reduced, {} inverse, {} raw", now.is_string() ? now.get<std::string>() : "unknown",
             frames("reduced"), frames("inverse"), frames("raw"));
  }
  if (count_of(answered(snapshot.status, "/gap_bursts")) > 0) out += line("profile  {}", describe_gap(snapshot.status));
  const auto frames = [&snapshot](const auto& row) { return frame_count(snapshot, row); };
  out += line("windows  {}", describe_counts(pipeline::kFrameCounters, frames));
  out += line("lost     {} in all", s.lost_total);
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    if (s.lost[i] == 0) continue;
    out += line("  {:<16} {:12} {:9.1f} /s", bolo::name(static_cast<LossCause>(i)), s.lost[i], s.lost_hz[i]);
  }
  return out;
}

nlohmann::ordered_json stat_json(const std::string& name, const StatSnapshot& snapshot, const StatSample& s) {
  const bolo_shm_header& h = snapshot.header;
  nlohmann::ordered_json json{{"name", name},
                              {"state", s.state},
                              {"pid", h.writer_pid},
                              {"uptime_s", s.uptime_s},
                              {"heartbeat_age_s", s.heartbeat_age_s},
                              {"camera_model", h.camera_model},
                              {"camera_serial", h.camera_serial},
                              {"width", h.width},
                              {"height", h.height},
                              {"frame_period_s", h.frame_period_s},
                              {"tau_s", h.tau_s},
                              {"window", h.window},
                              {"lookahead", h.lookahead},
                              {"slots", h.slot_count},
                              {"solver", h.solver},
                              {"interval_s", s.interval_s},
                              {"received", h.received},
                              {"published", h.published},
                              {"received_hz", s.received_hz},
                              {"published_hz", s.published_hz},
                              {"latency_p50_ms", s.latency_p50_ms},
                              {"latency_p99_ms", s.latency_p99_ms},
                              {"latency_max_ms", s.latency_max_ms},
                              {"latency_frames", s.latency_frames},
                              {"deblur_ms_per_frame", s.deblur_ms}};
  for (const auto& row : pipeline::kFrameCounters) {
    if (!row.words.empty()) json[std::string(row.key)] = frame_count(snapshot, row);
  }
  json["clock"] = {
      {"synchronised", h.clock_synchronised != 0}, {"error_s", seconds(h.clock_error_ns)}, {"steps", h.clock_steps}};
  json["lost_total"] = s.lost_total;
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    const std::string cause(bolo::name(static_cast<LossCause>(i)));
    json["lost"][cause] = s.lost[i];
    json["lost_hz"][cause] = s.lost_hz[i];
  }
  json["motion"] = nullptr;
  if (snapshot.motion) {
    json["motion"] = {
        {"x_px", snapshot.motion->x_px}, {"y_px", snapshot.motion->y_px}, {"sure_blocks", snapshot.motion->sure}};
  }
  if (snapshot.camera)
    json["camera"] = nlohmann::ordered_json::parse(shm::camera_json(*snapshot.camera, snapshot.at_ns));
  for (const char* key : {"effort", "stages", "video"}) json[key] = nullptr;
  if (!snapshot.status.is_object()) return json;
  for (const auto& [key, value] : snapshot.status.items()) {
    if (key != "ok" && (!json.contains(key) || json[key].is_null())) json[key] = value;
  }
  return json;
}

}  // namespace bolo::tools
