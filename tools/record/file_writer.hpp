// Frames from a queue in memory to capture files, on a thread of their own: a slow disk fills the queue, no more.
//
//   taker:  take() -> fills the slot -> put()            pool and queue are lock-free, each of one producer and one
//   writer: pops -> capture file -> gives the slot back   consumer; finish() joins
//   closer: waits for the disk with a file that is complete, while the writer goes on with the next one
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
  double split_s = 0.0;  // a new file each time the frames' times have advanced by this much; 0: one file
  std::size_t buffer_bytes = std::size_t{256} << 20;
  Replace replace = Replace::kNothing;
  // A line for the user while it goes on. Thread: the writer's.
  std::function<void(const std::string&)> log = [](const std::string&) {};
};

// Marks of events before a frame, as bits.
enum Mark : std::uint32_t {
  kMarkNone = 0,
  kMarkGap = 1U << 0,        // frames were lost by the recorder
  kMarkReconnect = 1U << 1,  // the daemon or the camera was started again
  kMarkNuc = 1U << 2,        // the camera began to correct
  kMarkMotion = 1U << 3,     // not before it: the frame's motion is known
  kMarkClockStep = 1U << 4,  // somebody set the host's clock
};

struct FileWriterResult {
  std::vector<std::filesystem::path> files;  // closed, under their final names
  std::vector<std::filesystem::path> parts;  // with frames, which could not get their final names
  std::uint64_t frames = 0;
  std::uint64_t unwritten = 0;  // frames that were in the queue when writing failed
  double longest_write_ms = 0.0;
  std::uint64_t bytes = 0;
  double first_t_s = 0.0;
  double last_t_s = 0.0;
  Status status;  // what ended the writing early
};

// Most memory that the control groups of this process let it have (a container's, MemoryMax= of a unit), bytes; the
// largest number: any. `tree`: where groups of version 2 are; `own`: what names the process's. Thread: any.
std::uint64_t memory_limit(const std::filesystem::path& tree = "/sys/fs/cgroup",
                           const std::filesystem::path& own = "/proc/self/cgroup");

// The name of file number `index` from 0: FILE itself without splitting, else FILE_001.h5 ... Thread: any.
std::filesystem::path file_of_part(const FileWriterOptions& options, std::size_t index);

// Refuses a first file where a recording, finished or not, exists. Thread: setup.
Status check_first_file(const FileWriterOptions& options);

class FileWriter {
 public:
  // Creates the first file and takes all memory. Later ones skip the numbers of existing files: frames are not lost for
  // a name. Thread: setup.
  static Result<std::unique_ptr<FileWriter>> start(FileWriterOptions options);
  ~FileWriter();

  // A free slot, or nullptr: the disk is behind by the whole buffer. put() hands it over. Thread: the taker.
  rt::FrameSlot* take() noexcept { return pool_.take(); }
  // Room for a slot's motion, of motion_blocks() of the frame; null without options.motion. Valid where put() is given
  // its mark. Thread: the taker.
  BlockMotion* motion_of(const rt::FrameSlot& slot) noexcept {
    return options_.motion ? motion_.data() + slot.index * blocks_ : nullptr;
  }
  // `period_s`: the stream's by now; the file states its last frame's.
  void put(rt::FrameSlot& slot, std::uint32_t marks, double period_s) noexcept;

  // Writing has failed; finish() has the error. Thread: any.
  bool broken() const noexcept { return broken_.load(std::memory_order_relaxed); }
  std::uint64_t written() const noexcept { return written_.load(std::memory_order_relaxed); }
  std::size_t slots() const noexcept { return pool_.size(); }

  // Writes what is in the queue, closes the file. Once. Thread: the taker.
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
  std::vector<BlockMotion> motion_;  // of each slot
  rt::SpscQueue<Item> queue_;
  std::atomic<bool> ending_{false};
  std::atomic<bool> broken_{false};
  std::atomic<std::uint64_t> written_{0};
  std::optional<capture::CaptureWriter> capture_;  // of the writer's thread, once it runs
  std::filesystem::path current_;
  std::deque<Closing> closing_;  // the oldest first
  std::size_t next_part_ = 0;
  std::uint64_t frames_in_file_ = 0;
  double file_begin_s_ = 0.0;
  std::int64_t last_commit_ns_ = 0;
  FileWriterResult result_;
  std::thread thread_;
};

}  // namespace bolo::tools
