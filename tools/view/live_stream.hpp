// A daemon's stream for the page, across restarts of the daemon: newest frame, traces of pixels, status.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "drivers/shm/followed_stream.hpp"
#include "tools/view/stat_sample.hpp"

namespace bolo::view {

// Position in the stream. Frames of another writer have another epoch, even with equal numbers.
struct Place {
  std::uint64_t epoch = 0;   // increases with each writer that is followed; 0: none yet
  std::uint64_t number = 0;  // publication order
  bool operator==(const Place&) const = default;
};

// A frame as sent, little-endian: FrameHead, raw plane, deblurred plane, bolo_shm_block_motion of each block.
struct FrameHead {
  char magic[4] = {'B', 'O', 'L', 'F'};
  std::uint16_t head_bytes = sizeof(FrameHead);
  std::uint16_t unit = 0;  // enum bolo_shm_unit
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  double scale = 0.0;   // kelvin per count
  double offset = 0.0;  // kelvin
  std::uint64_t epoch = 0;
  std::uint64_t number = 0;
  std::uint64_t frame_id = 0;
  std::int64_t camera_ns = 0;
  double age_ms = 0.0;      // from receiving the frame's first byte to this copy
  std::uint32_t flags = 0;  // enum bolo_shm_flag
  std::uint32_t row_step = 1;
  std::uint32_t motion_across = 0;  // blocks; 0: motion unknown for this frame
  std::uint32_t motion_down = 0;
  std::int64_t utc_ns = 0;  // when the camera took it: ns since 1970; 0: unknown
};
static_assert(sizeof(FrameHead) == 96);

class LiveStream {
 public:
  // Follows the daemon of this name on a thread of its own, waiting for it if it does not run. That thread calls
  // `on_frame` after each new frame. Thread: setup.
  LiveStream(std::string name, std::function<void()> on_frame);
  ~LiveStream();

  const std::string& name() const noexcept { return name_; }

  // The newest frame, unless it is the one at `seen`. Callers share one copy per frame. Thread: one at a time.
  std::shared_ptr<const std::string> newest_frame(const Place& seen);

  // {"epoch", "next", "period_s", "t_s", "raw", "deblurred"}: samples of one pixel, in counts, from the frame at `seen`
  // on: at most kTrace_s of them, starting with what the ring held at the pixel's first request. Lost frames are
  // missing. Pixels no longer requested are forgotten. Nothing: no such pixel, no stream, or too many pixels at once.
  // Thread: any.
  std::optional<nlohmann::ordered_json> trace(std::uint32_t x, std::uint32_t y, const Place& seen);

  // The output of `bolo stat --json` over about a second, and "view": {"stream": "live" | "silent" | "gone",
  // "obstacle", "followed", "epoch", "nuc"}. Thread: any.
  nlohmann::ordered_json status();

  static constexpr double kTrace_s = 10.0;
  static constexpr std::size_t kTraces = 16;

 private:
  struct Sample {
    std::uint64_t number;
    std::int64_t camera_ns;
    std::uint16_t raw;
    std::uint16_t deblurred;
  };
  struct Trace {
    std::uint32_t pixel;
    std::uint64_t next;  // publication number
    std::int64_t asked_ns;
    std::deque<Sample> samples;
  };

  void follow();
  void attach(const shm::FollowedStream& stream);
  void add_samples();
  void add_samples(Trace& trace, std::uint64_t published);
  void take_snapshot();

  const std::string name_;
  const std::function<void()> on_frame_;
  std::atomic<bool> ending_{false};

  std::mutex mutex_;  // guards the members up to now_
  std::optional<shm::ShmReader> reader_;
  bolo_shm_header format_{};
  std::uint64_t epoch_ = 0;
  std::int64_t last_frame_ns_ = 0;
  std::string obstacle_;
  std::vector<Trace> traces_;
  std::optional<tools::StatSnapshot> before_;
  std::optional<tools::StatSnapshot> now_;

  Place copied_;  // position of frame_; both belong to the caller of newest_frame()
  std::shared_ptr<const std::string> frame_;

  std::thread follower_;
};

}  // namespace bolo::view
