// Writes frames from a queue in memory to capture files, on a thread of its own: a slow disk only fills the queue.
//
//   taker:  take() -> fills the slot -> put()            pool and queue are lock-free, with one producer and one
//   writer: pops -> capture file -> returns the slot      consumer each; finish() joins
//   closer: waits for the disk with a complete file, while the writer continues with the next one
#pragma once

#include <atomic>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/rt/frame_pool.hpp"
#include "src/rt/spsc_queue.hpp"

namespace bolo::tools {

struct FileWriterOptions {
  std::filesystem::path file;
  capture::CaptureInfo info;
  std::vector<capture::Attribute> attributes;
  bool motion = false;   // frames may carry the scene's motion
  double split_s = 0.0;  // start a new file each time the frames' times have advanced this much; 0: one file
  std::size_t buffer_bytes = std::size_t{256} << 20;
  Replace replace = Replace::kNothing;
  // Prints a line for the user while recording. Thread: the writer's.
  std::function<void(const std::string&)> log = [](const std::string&) {};
};

// Bits that mark events before a frame.
enum Mark : std::uint32_t {
  kMarkNone = 0,
  kMarkGap = 1U << 0,        // the recorder lost frames
  kMarkReconnect = 1U << 1,  // the daemon or the camera was restarted
  kMarkNuc = 1U << 2,        // the camera began a NUC
  kMarkMotion = 1U << 3,     // of the frame itself: its motion is known
  kMarkClockStep = 1U << 4,  // the host's clock was set
};

struct FileWriterResult {
  std::vector<std::filesystem::path> files;  // closed, under their final names
  std::vector<std::filesystem::path> parts;  // contain frames, but could not be renamed to their final names
  std::uint64_t frames = 0;
  std::uint64_t unwritten = 0;  // still in the queue when writing failed
  double longest_write_ms = 0.0;
  std::uint64_t bytes = 0;
  double first_t_s = 0.0;
  double last_t_s = 0.0;
  Status status;  // the error that ended writing early
};

// Memory limit of this process' control groups (a container's, MemoryMax= of a unit), bytes; the largest number: none.
// `tree`: mount point of cgroup v2; `own`: file that names the process' group. Thread: any.
std::uint64_t memory_limit(const std::filesystem::path& tree = "/sys/fs/cgroup",
                           const std::filesystem::path& own = "/proc/self/cgroup");

// Name of file number `index`, from 0: FILE itself without splitting, else FILE_001.h5 ... Thread: any.
std::filesystem::path file_of_part(const FileWriterOptions& options, std::size_t index);

// Refuses a first file if a recording, finished or not, exists there. Thread: setup.
Status check_first_file(const FileWriterOptions& options);

class FileWriter {
 public:
  // Creates the first file and allocates all memory. Later files skip the numbers of existing ones. Thread: setup.
  static Result<std::unique_ptr<FileWriter>> start(FileWriterOptions options);
  ~FileWriter();

  // A free slot, to be handed over by put(); nullptr: the disk is behind by the whole buffer. Thread: the taker.
  rt::FrameSlot* take() noexcept { return pool_.take(); }
  // Buffer for the motion of a slot's frame, motion_blocks() of it; null without options.motion. Used if put() gets
  // kMarkMotion. Thread: the taker.
  BlockMotion* motion_of(const rt::FrameSlot& slot) noexcept {
    return options_.motion ? motion_.data() + slot.index * blocks_ : nullptr;
  }
  // `period_s`: the stream's current period; the file states that of its last frame.
  void put(rt::FrameSlot& slot, std::uint32_t marks, double period_s) noexcept;

  // True when writing has failed; finish() returns the error. Thread: any.
  bool broken() const noexcept { return broken_.load(std::memory_order_relaxed); }
  std::uint64_t written() const noexcept { return written_.load(std::memory_order_relaxed); }
  std::size_t slots() const noexcept { return pool_.size(); }

  // Writes the queued frames and closes the file. Call once. Thread: the taker.
  FileWriterResult finish();

 private:
  struct Item {
    std::uint32_t slot;
    std::uint32_t marks;
    double period_s;
  };
  struct Closing {
    std::filesystem::path file;
    std::future<Status> outcome;
  };
  explicit FileWriter(FileWriterOptions options);
  Status open_next();
  Result<capture::CaptureWriter> create(std::size_t part) const;
  Status close_current();
  void take_closed(bool wait);
  void run() noexcept;
  void write(rt::FrameSlot& slot, const Item& item);
  Status append(const rt::FrameSlot& slot, const Item& item);
  void commit_if_idle();
  void fail(Status status);

  FileWriterOptions options_;
  rt::FramePool pool_;
  std::size_t blocks_;
  std::vector<BlockMotion> motion_;  // one per slot
  rt::SpscQueue<Item> queue_;
  std::atomic<bool> ending_{false};
  std::atomic<bool> broken_{false};
  std::atomic<std::uint64_t> written_{0};
  std::optional<capture::CaptureWriter> capture_;  // used by the writer's thread only, once that runs
  std::filesystem::path current_;
  std::deque<Closing> closing_;  // oldest first
  std::size_t next_part_ = 0;
  std::uint64_t frames_in_file_ = 0;
  double file_begin_s_ = 0.0;
  std::int64_t last_commit_ns_ = 0;
  FileWriterResult result_;
  std::thread thread_;
};

}  // namespace bolo::tools
