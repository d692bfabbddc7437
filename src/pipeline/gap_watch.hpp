// Checks on the live stream that the pixels still match the camera's profile (gap_meter.hpp).
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "src/core/frame.hpp"
#include "src/deblur/gap_meter.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/stats.hpp"

namespace bolo::pipeline {

// Medians of the last five bursts with a result, once there are three. Thread: one at a time.
class GapTrend {
 public:
  // The profile's time constant and noise (K, or counts).
  GapTrend(double tau_s, double noise_k) : tau_s_(tau_s), noise_k_(noise_k) {}

  // A notice when the camera begins or ceases to differ from its profile: the time constant by 10 % (ends within 5 %),
  // the noise, measured in still pictures only, by half (ends within 30 %).
  std::optional<Notice> add(const deblur::GapFigures& figures);

  // 0: not known yet.
  double ratio() const { return ratio_.median(); }
  double tau_ratio() const { return tau_.median(); }
  double noise_ratio() const { return noise_.median(); }

 private:
  class Last {
   public:
    void add(double value);
    double median() const;

   private:
    std::deque<double> values_;
  };

  double tau_s_;
  double noise_k_;
  Last ratio_;
  Last tau_;
  Last noise_;
  bool grown_ = false;
};

// Takes a burst of consecutive frames periodically, and evaluates it on a thread of the lowest priority.
class GapWatch {
 public:
  // Planes of `format`. `interval_s`: between two bursts. Results go to the stats' gauges. Thread: setup.
  GapWatch(const StreamFormat& format, double tau_s, double noise_k, double interval_s, PipelineStats& stats);
  ~GapWatch();

  // Copies the frame during a burst; a gap, a NUC or a restart of the window restarts the burst. Thread: pipeline.
  void offer(const FrameMeta& meta, const void* plane, bool restart) noexcept;

  // Thread: any.
  std::vector<Notice> take_notices() { return notices_.take(); }

 private:
  void run();
  void evaluate();

  const std::size_t plane_bytes_;
  PipelineStats& stats_;
  deblur::GapMeter meter_;
  GapTrend trend_;
  std::vector<std::byte> burst_;
  // Owner of the burst: passes by the watcher's store to offer()'s load, and back by offer()'s store to run()'s wait.
  enum Turn : int { kWatcher, kPipeline };
  std::atomic<int> turn_{kWatcher};
  int taken_ = 0;
  FrameMeta first_;
  FrameMeta last_;
  Notices notices_;
  const std::int64_t interval_ns_;
  std::mutex mutex_;
  std::condition_variable end_;
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace bolo::pipeline
