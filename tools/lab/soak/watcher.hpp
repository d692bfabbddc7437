// The scene of the soak's camera with its expected planes; judgement of each published frame: order, pixels, flags.
#pragma once

#include <deque>
#include <unordered_map>

#include "drivers/shm/followed_stream.hpp"
#include "tools/lab/soak/findings.hpp"

namespace bolo::tools::soak {

// --- Every plane that bolod may publish.

struct Recognised {
  std::size_t index = 0;  // in the capture
  int offset = 0;         // of all pixels, counts: by a shutter fault
};

inline constexpr double kShutterOffset_k = 0.5;
// Camera time of the capture's first frame, and so of each stream's: above 0, where a clock that jumps back must not
// arrive.
inline constexpr double kFirst_s = 10.0;

class Truth {
 public:
  using Planes = std::vector<std::vector<std::uint16_t>>;

  // `deblurred`: of the same frames in an endless loop; empty: unknown. Thread: setup.
  Truth(Planes raw, Planes deblurred);

  // The capture's frame that this plane shows, all values equal up to a common offset.
  // `scratch`: working memory of the caller. Thread: any.
  std::optional<Recognised> recognise(const std::uint16_t* raw, std::vector<std::uint16_t>& scratch) const;

  // True if this is an undisturbed run's plane of the capture's frame; with an offset, within its rounding. Thread:
  // any.
  bool right(const std::uint16_t* deblurred, std::size_t index, int offset) const;

  std::size_t frames() const noexcept { return raw_.size(); }

 private:
  Planes raw_;
  std::unordered_map<std::uint32_t, std::size_t> by_checksum_;  // of a plane minus its first pixel
  Planes deblurred_;
};

// A passing street, written as a capture for the fake camera, and the result of `pipeline` on it in an endless loop.
// Thread: setup.
Result<Truth> make_scene(Geometry geometry, double rate_hz, std::size_t frames,
                         const pipeline::PipelineOptions& pipeline, const std::filesystem::path& capture);

struct Shown {
  std::uint64_t number = 0;  // publication order
  std::uint64_t missed = 0;  // published before it, but overwritten before this program read them
  std::uint64_t frame_id = 0;
  std::int64_t camera_ns = 0;
  std::int64_t receive_ns = 0;
  std::int64_t publish_ns = 0;
  std::uint32_t flags = 0;
  const std::uint16_t* raw = nullptr;
  const std::uint16_t* deblurred = nullptr;
};

enum class Grade {
  kClean,     // no flag, both planes right
  kSparing,   // solved at a lower quality level and flagged so; the raw plane is right
  kFlagged,   // another flag; the raw plane is right
  kSettling,  // no flag, another plane: less than a window after a fault that the frames' numbers do not reveal
  kWrong,     // no flag, another plane, no allowed reason; or a raw plane that is not the camera's
};

inline constexpr std::size_t kGrades = 5;

// Thread: one at a time.
class FrameJudge {
 public:
  // `window`: frames used for one estimate, including look-ahead.
  FrameJudge(const Truth& truth, int window, Findings& findings)
      : truth_(truth), window_(window), findings_(findings) {}

  // A new daemon, whose numbers start again.
  void begin_life() noexcept;
  // Allows this offset of the camera besides none; any other is wrong.
  void allow(int offset) noexcept { allowed_ = offset; }
  Grade judge(const Shown& frame);

 private:
  void check_order(const Shown& frame);
  void follow(const Shown& frame, const Recognised& seen) noexcept;

  const Truth& truth_;
  std::vector<std::uint16_t> scratch_;
  int window_;
  Findings& findings_;
  int allowed_ = 0;
  std::optional<Shown> last_;  // its planes are no longer valid
  std::optional<Recognised> before_;
  int settled_ = 0;  // frames since a fault that the frames' numbers do not reveal
};

// --- Follows the daemon's shared memory frame by frame in its own thread, and judges each frame.

// A frame with the daemon's counts.
struct Position {
  std::int64_t camera_ns = 0;
  std::int64_t receive_ns = 0;
  std::int64_t publish_ns = 0;
  std::uint64_t number = 0;
  std::uint64_t frame_id = 0;
  int life = 0;                 // of the daemon: 0, 1 ...
  std::uint64_t published = 0;  // frames up to this one, all lives
  std::uint64_t lost = 0;       // at the time of reading, all lives, all causes
  double silence_s = 0.0;       // total time without frames, counting silences above kSilence_s
};
inline constexpr double kSilence_s = 0.05;

// True if no frame is missing around it and it is so old that no count of it is in flight: only there can counts be
// compared.
bool settled(const std::deque<Position>& seen, std::size_t at);

// Counts since the last call.
struct Flow {
  std::array<std::uint64_t, kGrades> grades{};  // frames, by Grade
  std::uint64_t undone = 0;                     // frames published raw, because too many were waiting
  std::vector<double> latency_ms;               // received to published
  std::uint64_t missed = 0;
};

// The present run of good frames, allowing frames of a lower quality level. Frames with other flags, wrong frames and
// silences end it.
struct GoodRun {
  std::int64_t since_ns = 0;
  std::int64_t last_ns = 0;
  std::uint64_t frames = 0;
};

struct Counters {
  int life = 0;
  faults::Losses lost{};  // all lives
};

class Watcher {
  template <typename Get>
  auto locked(Get get) const {
    const std::lock_guard lock(mutex_);
    return get();
  }

 public:
  // Waits for the stream; `truth` and `findings` must outlive the watcher. Thread: setup.
  static Result<std::unique_ptr<Watcher>> start(const std::string& name, const Truth& truth, Findings& findings);
  ~Watcher();
  Watcher(const Watcher&) = delete;
  Watcher& operator=(const Watcher&) = delete;

  // Thread: any.
  void allow(int offset) {
    locked([&] { judge_.allow(offset); });
  }
  Flow take_flow() {
    return locked([&] { return std::exchange(flow_, {}); });
  }
  GoodRun good_run() const {
    return locked([&] { return good_; });
  }
  Counters counters() const {
    return locked([&] { return counters_; });
  }
  // The frame with this camera time that was received at about that time; empty as long as it is not settled.
  std::optional<Position> find(std::int64_t camera_ns, std::int64_t about_ns) const;
  const bolo_shm_header& first_header() const noexcept { return first_header_; }

 private:
  Watcher(shm::FollowedStream stream, const Truth& truth, Findings& findings);
  void poll();
  void take(const shm::BorrowedFrame& frame, std::uint64_t missed);
  void begin_life();
  void count(const shm::ShmReader& reader);
  void note_good(Grade grade, std::int64_t publish_ns);

  shm::FollowedStream stream_;
  bolo_shm_header first_header_;
  std::optional<shm::ShmReader> present_;  // object of the present life: its counters outlast the writer
  std::vector<std::uint16_t> raw_;
  std::vector<std::uint16_t> deblurred_;
  std::atomic<bool> stop_{false};

  mutable std::mutex mutex_;
  FrameJudge judge_;
  std::deque<Position> seen_;
  Flow flow_;
  GoodRun good_;
  Counters counters_;
  faults::Losses lost_before_{};  // in previous lives
  std::uint64_t published_ = 0;
  std::uint64_t unread_ = 0;  // overwritten frames since the last judged one
  double silence_s_ = 0.0;
  std::int64_t last_publish_ns_ = 0;

  std::thread thread_;
};

}  // namespace bolo::tools::soak
