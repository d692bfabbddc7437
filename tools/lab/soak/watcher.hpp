// The scene of the soak's camera and its expected planes; judgement of each published frame's order, pixels and flags.
#pragma once

#include <deque>
#include <unordered_map>

#include "drivers/shm/followed_stream.hpp"
#include "tools/lab/soak/findings.hpp"

namespace bolo::tools::soak {

// --- Every plane that bolod may publish.

struct Recognised {
  std::size_t index = 0;  // in the capture
  int offset = 0;         // of all pixels, counts: a shutter's
};

inline constexpr double kShutterOffset_k = 0.5;
// Time of the first frame of capture and streams: keeps a clock that jumps back above 0, where it would stop.
inline constexpr double kFirst_s = 10.0;

class Truth {
 public:
  using Planes = std::vector<std::vector<std::uint16_t>>;

  // `deblurred`: of the same frames in an endless loop; empty: unknown. Thread: setup.
  Truth(Planes raw, Planes deblurred);

  // The capture's frame with these values, up to a common offset. `scratch`: working memory of the caller. Thread: any.
  std::optional<Recognised> recognise(const std::uint16_t* raw, std::vector<std::uint16_t>& scratch) const;

  // True if this is the undisturbed plane of the capture's frame; with an offset, up to rounding. Thread: any.
  bool right(const std::uint16_t* deblurred, std::size_t index, int offset) const;

  std::size_t frames() const noexcept { return raw_.size(); }

 private:
  Planes raw_;
  std::unordered_map<std::uint32_t, std::size_t> by_checksum_;  // of planes relative to their first pixel
  Planes deblurred_;
};

// A street that passes by, as a capture for the fake camera, and its endless loop through `pipeline`. Thread: setup.
Result<Truth> make_scene(Geometry geometry, double rate_hz, std::size_t frames,
                         const pipeline::PipelineOptions& pipeline, const std::filesystem::path& capture);

// --- Each published frame.

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
  kClean,     // no flag; both planes are right
  kSparing,   // flagged as solved with less effort; the raw plane is right
  kFlagged,   // another flag; the raw plane is right
  kSettling,  // no flag, but another plane: less than a window after a fault that frame numbers do not show
  kWrong,     // no flag, another plane, no excuse; or a raw plane that the camera never sent
};

inline constexpr std::size_t kGrades = 5;

// Thread: one at a time.
class FrameJudge {
 public:
  // `window`: frames used for an estimate, including the look-ahead.
  FrameJudge(const Truth& truth, int window, Findings& findings)
      : truth_(truth), window_(window), findings_(findings) {}

  // A new daemon, whose numbers start anew.
  void begin_life() noexcept;
  // The offset, besides 0, that the camera may show now.
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
  int settled_ = 0;  // frames since a fault that later frames do not show
};

// --- Follows the daemon's shared memory on a separate thread and judges each frame.

// A frame in the daemon's counts.
struct Position {
  std::int64_t camera_ns = 0;
  std::int64_t receive_ns = 0;
  std::int64_t publish_ns = 0;
  std::uint64_t number = 0;
  std::uint64_t frame_id = 0;
  int life = 0;                 // of the daemon: 0, 1 ...
  std::uint64_t published = 0;  // frames up to this one, over all lives
  std::uint64_t lost = 0;       // when it was read, over all lives and causes
  double silence_s = 0.0;       // sum of times without a frame, each above kSilence_s
};
inline constexpr double kSilence_s = 0.05;

// True if no frame is missing around it and nothing before it is still in flight: only there counts are comparable.
bool settled(const std::deque<Position>& seen, std::size_t at);

// Counts since the last call.
struct Flow {
  std::array<std::uint64_t, kGrades> grades{};  // frames by Grade
  std::uint64_t undone = 0;                     // frames published raw, because too many were waiting
  std::vector<double> latency_ms;               // from reception to publication
  std::uint64_t missed = 0;
};

// The present run of clean frames or ones solved with less effort; other flags, wrong frames and silence end it.
struct GoodRun {
  std::int64_t since_ns = 0;
  std::int64_t last_ns = 0;
  std::uint64_t frames = 0;
};

struct Counters {
  int life = 0;
  faults::Losses lost{};  // over all lives
};

class Watcher {
  template <typename Get>
  auto locked(Get get) const {
    const std::lock_guard lock(mutex_);
    return get();
  }

 public:
  // Waits for the stream. `truth` and `findings` must outlive this. Thread: setup.
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
  // The frame with this camera time received at about `about_ns`; nothing until it has settled.
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
  faults::Losses lost_before_{};  // in past lives
  std::uint64_t published_ = 0;
  std::uint64_t unread_ = 0;  // frames overwritten since the last one judged
  double silence_s_ = 0.0;
  std::int64_t last_publish_ns_ = 0;

  std::thread thread_;
};

}  // namespace bolo::tools::soak
