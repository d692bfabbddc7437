// A running daemon's frames against the truth of the capture that its fake camera replays.
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

// --- Plot of `bolo-lab eval live` and `bolo demo`: one live frame blurred, deblurred and true, a line through its
// steepest edges, and the latency of all frames.

// The frame with the most to see, K.
struct ShownFrame {
  Geometry geometry;
  std::size_t index = 0;  // in the capture that the camera replays
  double camera_s = 0.0;
  std::vector<float> blurred;
  std::vector<float> deblurred;
  std::vector<float> truth;
};

class FrameChoice {
 public:
  // `only`: no other frame of the capture will do.
  explicit FrameChoice(std::optional<std::size_t> only = {}) : only_(only) {}
  // Keeps this frame (kelvin), number `index` of the capture, when it shows more detail than the one kept so far.
  void take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth,
            std::size_t index);
  const ShownFrame& shown() const { return shown_; }
  // The only one that will do did not come yet.
  bool waits() const { return only_ && shown_.truth.empty(); }

 private:
  std::optional<std::size_t> only_;
  double detail_ = -1.0;
  ShownFrame shown_;
};

struct LiveFigures {
  std::string name = "deblurred";  // of what was solved: the solver, where there are several
  double rmse_before_k = 0.0;      // over the run
  double rmse_after_k = 0.0;
  double period_s = 0.0;
  std::vector<double> latency_ms;  // of each frame, in order
};

// One frame as one solver or several made it, with the figures of each: first those of the solver that `shown` is of.
struct LiveResult {
  const ShownFrame* shown;
  LiveFigures figures;
};

// Thread: any.
plot::Sheet sheet_of(std::span<const LiveResult> results);

// --- Which frame of a capture a live frame is, when a fake camera replays the capture again and again.

class TruthClock {
 public:
  // `t`: the capture's times, s. At each lap the fake camera's clock goes on by the capture's span and one period.
  TruthClock(const std::vector<double>& t, double period_s);

  // The capture's frame that was sampled at camera_ns, or nothing when no frame lies within a quarter of a period.
  // Thread: any.
  std::optional<std::size_t> frame_at(std::int64_t camera_ns) const;

 private:
  std::vector<double> t_;  // from the first frame, s
  double period_s_;
  double first_s_;
  double lap_s_;
};

// Squared errors over all pixels of the judged frames, K.
struct ErrorSum {
  double before = 0.0;
  double after = 0.0;
  std::uint64_t values = 0;

  double rmse_before() const { return values > 0 ? std::sqrt(before / static_cast<double>(values)) : 0.0; }
  double rmse_after() const { return values > 0 ? std::sqrt(after / static_cast<double>(values)) : 0.0; }
};

struct LiveOutcome {
  std::uint64_t frames_read = 0;
  std::uint64_t overwritten = 0;    // published, but this reader was too slow for them
  std::uint64_t frames_judged = 0;  // had a full window and a truth
  std::uint64_t spared = 0;         // of the judged: less was spent on them, since the computer was too slow
  std::uint64_t raw_differs = 0;    // raw planes that are not the capture's, value by value
  std::vector<double> latency_ms;
  ErrorSum error;
  FrameChoice shown;
  bolo_shm_header first{};
  bolo_shm_header last{};
};

// Reads the daemon's shared memory for `seconds`, or until interrupted(). `shown`: the frame of the capture that is to
// be shown, which is waited for, two laps of the capture at most; without it the one with the most to see. kBadInput
// when the capture has no truth or another size; kFailed when frames stop. Thread: one at a time.
Result<LiveOutcome> check_live(const std::string& name, const std::filesystem::path& truth, double seconds,
                               std::optional<std::size_t> shown = {});

// The figures, as `bolo-lab eval live --json` and its text have them. Thread: any.
nlohmann::ordered_json to_json(const LiveOutcome& outcome);
void print_text(const nlohmann::ordered_json& figures);

}  // namespace bolo::tools
