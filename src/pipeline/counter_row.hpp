// The numbers that a daemon keeps of its frames and its camera, a row each. Shared memory, metrics, JSON, `bolo stat`
// and the journal's last message are made from these rows: a new number is a member of PipelineStats or SourceStatus, a
// row here, and the place that counts.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>

#include "bolo/shm_layout.h"
#include "src/pipeline/stats.hpp"

namespace bolo::pipeline {

enum class RowKind : std::uint8_t {
  kCount,  // uint64
  kNs,     // int64
  kSince,  // int64, CLOCK_MONOTONIC; in JSON how many seconds ago, null for 0
  kReal,   // double
};

// What only some rows have.
struct InStat {
  std::string_view words{};  // behind the number in `bolo stat`
};
struct AtEnd {
  bool at_end = false;  // the journal's last message has it, as KEY or KEY_PART
};
struct ByLabel {  // one number for each of several parts
  std::string_view label{};
  std::size_t parts = 1;
  std::string_view (*part_name)(std::size_t part) = nullptr;
};
struct Reading {
  RowKind kind = RowKind::kCount;
  double json_scale = 1.0;  // of kNs and kReal
  double metric_scale = 1.0;
  std::size_t known_by = 0;  // offset of the word that is 0, and JSON null, while it is not known; 0: its own
};

template <typename Source>
struct CounterRow : InStat, AtEnd, ByLabel, Reading {
  using Read = std::uint64_t (*)(const Source& source, std::size_t part) noexcept;
  template <typename... Extras>
  constexpr CounterRow(Read r, std::size_t at, std::string_view k = {}, std::string_view m = {},
                       std::string_view h = {}, Extras... extras)
      : read(r), shared(at), key(k), metric(m), help(h) {
    ((static_cast<Extras&>(*this) = extras), ...);
  }

  Read read;                // its 64 bits. Thread: any
  std::size_t shared;       // offset in bolo_shm_header or bolo_shm_camera; 0: not written there with the others
  std::string_view key;     // of JSON; empty: not there, or not by itself
  std::string_view metric;  // of Prometheus: a counter when it ends in _total, else a gauge; empty: not there
  std::string_view help;
};

template <typename Enum>
constexpr ByLabel by(std::string_view label, std::size_t count) {
  return {label, count, [](std::size_t part) { return name(static_cast<Enum>(part)); }};
}

// As JSON and metrics have it: "control lost" is control_lost. Thread: any.
template <typename Source>
std::string part_key(const CounterRow<Source>& row, std::size_t part) {
  std::string key(row.part_name(part));
  for (char& letter : key) letter = letter == ' ' ? '_' : letter;
  return key;
}

// The member's 64 bits; of an array, those of its part.
template <auto kMember, typename Source>
std::uint64_t word_of(const Source& source, std::size_t part) noexcept {
  const auto bits = [](auto value) {
    if constexpr (std::is_same_v<decltype(value), double>) return std::bit_cast<std::uint64_t>(value);
    return static_cast<std::uint64_t>(value);
  };
  if constexpr (requires { (source.*kMember)[part]; })
    return bits((source.*kMember)[part].value());
  else
    return bits((source.*kMember).value());
}

inline std::uint64_t losses_word(const PipelineStats& stats, std::size_t part) noexcept {
  return stats.inlet.losses().value(static_cast<LossCause>(part));
}

inline std::uint64_t received_word(const PipelineStats& stats, std::size_t /*part*/) noexcept {
  return stats.inlet.received();
}

using FrameRow = CounterRow<PipelineStats>;
inline constexpr std::array kFrameCounters{
    FrameRow(received_word, offsetof(bolo_shm_header, received), "received", "bolo_frames_received_total",
             "Whole frames that reached the queue", AtEnd{true}),
    // In shared memory by itself: readers take frames by it.
    FrameRow(word_of<&PipelineStats::published>, 0, "published", "bolo_frames_published_total",
             "Frames handed to the sinks", AtEnd{true}),
    FrameRow(losses_word, offsetof(bolo_shm_header, lost), "lost", "bolo_frames_lost_total",
             "Frames lost, by the first cause that took them", by<LossCause>("cause", kLossCauses), AtEnd{true}),
    FrameRow(word_of<&PipelineStats::repeats>, 0, "", "bolo_frames_repeated_total",
             "Frames dropped that repeated the one before; among the missing, too"),
    FrameRow(word_of<&PipelineStats::warm_up>, offsetof(bolo_shm_header, warm_up), "warm_up",
             "bolo_frames_warm_up_total", "Frames published without a full window behind them", InStat{"warm-up"}),
    FrameRow(word_of<&PipelineStats::gap_frames>, offsetof(bolo_shm_header, gap_frames), "gap_frames",
             "bolo_frames_gap_total", "Frames published with a lost one in their window", InStat{"with gaps"}),
    FrameRow(word_of<&PipelineStats::by_effort>, 0, "", "bolo_frames_effort_total",
             "Frames with a full window, by what was spent on them: less than full when too many were waiting",
             by<QualityLevel>("effort", kQualityLevels)),
    FrameRow(word_of<&PipelineStats::restarts>, offsetof(bolo_shm_header, restarts), "restarts",
             "bolo_window_restarts_total", "Windows emptied: NUC, reconnect, a jump in time", InStat{"restarts"}),
    FrameRow(word_of<&PipelineStats::deblur_ns>, offsetof(bolo_shm_header, deblur_ns)),
};

using CameraRow = CounterRow<SourceStatus>;
inline constexpr std::array kCameraCounters{
    CameraRow(word_of<&SourceStatus::state>, offsetof(bolo_shm_camera, state)),
    CameraRow(word_of<&SourceStatus::since_ns>, offsetof(bolo_shm_camera, since_ns)),
    CameraRow(word_of<&SourceStatus::lost>, offsetof(bolo_shm_camera, lost), "lost", "bolo_camera_lost_total",
              "Times that the camera was given up, by cause", by<LostCause>("cause", kLostCauses)),
    CameraRow(word_of<&SourceStatus::reopened>, offsetof(bolo_shm_camera, reopened), "reopened",
              "bolo_camera_reconnects_total", "Times that it was opened again"),
    CameraRow(word_of<&SourceStatus::stalls>, offsetof(bolo_shm_camera, stalls), "stalls", "bolo_camera_stalls_total",
              "Times that frames stopped"),
    CameraRow(word_of<&SourceStatus::outage_frames>, offsetof(bolo_shm_camera, outage_frames), "outage_frames",
              "bolo_camera_outage_frames_total", "Frames that would have come while it was lost"),
    CameraRow(word_of<&SourceStatus::corrections>, offsetof(bolo_shm_camera, corrections), "nucs",
              "bolo_camera_corrections_total", "Corrections of its pixels (NUC) that were asked for"),
    CameraRow(word_of<&SourceStatus::correction_ns>, offsetof(bolo_shm_camera, correction_ns), "nuc_age_s", "", "",
              Reading{RowKind::kSince}),
    CameraRow(word_of<&SourceStatus::clock_offset_ns>, offsetof(bolo_shm_camera, clock_offset_ns), "clock_offset_s", "",
              "", Reading{RowKind::kNs, 1e-9}),
    CameraRow(word_of<&SourceStatus::clock_drift_ppm>, offsetof(bolo_shm_camera, clock_drift_ppm), "clock_drift_ppm",
              "bolo_camera_clock_drift_ratio", "By how much its clock is slower than the host's",
              Reading{RowKind::kReal, 1.0, 1e-6, offsetof(bolo_shm_camera, clock_offset_ns)}),
    CameraRow(word_of<&SourceStatus::clock_jitter_ns>, offsetof(bolo_shm_camera, clock_jitter_ns), "clock_jitter_ms",
              "bolo_camera_clock_jitter_seconds", "Of the way from camera to host, rms over its shortest",
              Reading{RowKind::kReal, 1e-6, 1e-9, offsetof(bolo_shm_camera, clock_offset_ns)}),
    CameraRow(word_of<&SourceStatus::clock_jumps>, offsetof(bolo_shm_camera, clock_jumps), "clock_jumps",
              "bolo_camera_clock_jumps_total", "Jumps of its clock"),
    CameraRow(word_of<&SourceStatus::received_packets>, offsetof(bolo_shm_camera, received_packets), "received_packets",
              "bolo_camera_packets_received_total", "Packets, as the transport counts them", InStat{"received"}),
    CameraRow(word_of<&SourceStatus::missing_packets>, offsetof(bolo_shm_camera, missing_packets), "missing_packets",
              "bolo_camera_packets_missing_total", "Packets that never came", InStat{"missing"}),
    CameraRow(word_of<&SourceStatus::resent_packets>, offsetof(bolo_shm_camera, resent_packets), "resent_packets",
              "bolo_camera_packets_resent_total", "Packets that came when asked for again", InStat{"sent again"}),
    CameraRow(word_of<&SourceStatus::temperature_k>, offsetof(bolo_shm_camera, temperature_k), "temperature_k", "", "",
              Reading{RowKind::kReal}),
};

// Parts of a frame's latency, in the order in which it passes them.
struct StageRow {
  std::string_view name;
  rt::LatencyHistogram StageLatencies::*latency;
};
inline constexpr std::array kStages{
    StageRow{"arrival", &StageLatencies::arrival}, StageRow{"queue", &StageLatencies::queue},
    StageRow{"deblur", &StageLatencies::deblur}, StageRow{"publish", &StageLatencies::publish}};

// Calls store(index, word) for all that is in shared memory; the index is in words from its structure's begin.
template <typename Rows, typename Source, typename Store>
void each_shared_word(const Rows& rows, const Source& source, const Store& store) noexcept {
  for (const auto& row : rows) {
    if (row.shared == 0) continue;
    for (std::size_t i = 0; i < row.parts; ++i) store(row.shared / sizeof(std::uint64_t) + i, row.read(source, i));
  }
}

}  // namespace bolo::pipeline
