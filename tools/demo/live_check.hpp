// Compares a running daemon's frames with the truth of the capture that its fake camera replays.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "bolo/shm_layout.h"
#include "drivers/shm/shm_reader.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/report/plot.hpp"

namespace bolo::tools {

// --- Plot of `bolo-lab eval live` and `bolo demo`: a frame blurred, deblurred and true, a profile through it, latency.

// The frame with the most detail, K.
struct ShownFrame {
  Geometry geometry;
  std::size_t index = 0;  // in the replayed capture
  double camera_s = 0.0;
  std::vector<float> blurred;
  std::vector<float> deblurred;
  std::vector<float> truth;
};

class FrameChoice {
 public:
  // `only`: accept no other frame of the capture.
  explicit FrameChoice(std::optional<std::size_t> only = {}) : only_(only) {}
  // Keeps this frame (converted to kelvin), number `index` of the capture, if it shows more detail than the kept one.
  void take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth,
            std::size_t index);
  const ShownFrame& shown() const { return shown_; }
  // True until the only acceptable frame arrives.
  bool waits() const { return only_ && shown_.truth.empty(); }

 private:
  std::optional<std::size_t> only_;
  double detail_ = -1.0;
  ShownFrame shown_;
};

struct LiveFigures {
  std::string name = "deblurred";  // label of the solved plane: the solver, if there are several
  double rmse_before_k = 0.0;      // over the whole run
  double rmse_after_k = 0.0;
  double period_s = 0.0;
  std::vector<double> latency_ms;  // of each frame, in order
};

// One frame and the figures of each solver; first those of the solver to which `shown` belongs.
struct LiveResult {
  const ShownFrame* shown;
  LiveFigures figures;
};

// Thread: any.
plot::Sheet sheet_of(std::span<const LiveResult> results);

// --- Frame numbers of a capture that a fake camera replays in a loop.

class TruthClock {
 public:
  // `t`: times of the capture, s. Each lap advances the fake camera's clock by the capture's span and one period.
  TruthClock(const std::vector<double>& t, double period_s);

  // Index of the capture's frame sampled at camera_ns; nothing if none lies within a quarter of a period. Thread: any.
  std::optional<std::size_t> frame_at(std::int64_t camera_ns) const;

 private:
  std::vector<double> t_;  // since the first frame, s
  double period_s_;
  double first_s_;
  double lap_s_;
};

// Squared errors over all pixels of the judged frames, K^2.
struct ErrorSum {
  double before = 0.0;
  double after = 0.0;
  std::uint64_t values = 0;

  double rmse_before() const { return values > 0 ? std::sqrt(before / static_cast<double>(values)) : 0.0; }
  double rmse_after() const { return values > 0 ? std::sqrt(after / static_cast<double>(values)) : 0.0; }
};

struct LiveOutcome {
  std::uint64_t frames_read = 0;
  std::uint64_t overwritten = 0;    // published, but overwritten before this reader got to them
  std::uint64_t frames_judged = 0;  // with a full window and a truth
  std::uint64_t spared = 0;         // of the judged: with reduced effort, since the computer was too slow
  std::uint64_t raw_differs = 0;    // raw planes that differ from the capture's in any value
  std::vector<double> latency_ms;
  ErrorSum error;
  FrameChoice shown;
  bolo_shm_header first{};
  bolo_shm_header last{};
};

// Reads the daemon's shared memory for `seconds`, or until interrupted(). `shown`: the capture's frame to show, for
// which it waits two laps of the capture at most; by default the one with the most detail. kBadInput when the capture
// has no truth or another size; kFailed when frames stop. Thread: one at a time.
Result<LiveOutcome> check_live(const std::string& name, const std::filesystem::path& truth, double seconds,
                               std::optional<std::size_t> shown = {});

// The figures of `bolo-lab eval live`, as JSON and as text. Thread: any.
nlohmann::ordered_json to_json(const LiveOutcome& outcome);
void print_text(const nlohmann::ordered_json& figures);

}  // namespace bolo::tools
