// The steps of a commit that wait for the disk, C1 to C4 of crash_safe_file.hpp, on a thread of their own.
//
//   writer: begin() ------------------> goes on writing ----> ended(): takes note of the outcome, forgets the pages
//   disk:     C1 sync, C2 record, C3 sync, C4 pages ------^
//
// The pages stay as they are until the writer forgets them: both threads read them meanwhile.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <thread>

#include "src/capture/pages.hpp"

namespace bolo::capture {

enum class SurvivesCut { kProcess, kPower };

struct CommitFiles {
  std::filesystem::path name;
  int file = -1;
  int journal = -1;
};

// C1 to C4; without the syncs where only the death of the process is to be survived. 0, or an errno; then it can be
// called again. Thread: any one at a time.
int commit_pages(const CommitFiles& files, const PageRecord& record, std::uint64_t end, SurvivesCut survives);

class PowerCommit {
 public:
  // `files` stay open for as long as this lives. Throws std::system_error where no thread can be started. Thread:
  // setup.
  explicit PowerCommit(CommitFiles files);
  // Waits for the end of what was begun.
  ~PowerCommit();
  PowerCommit(const PowerCommit&) = delete;
  PowerCommit& operator=(const PowerCommit&) = delete;

  // All below: Thread: the writer's.
  // Not before the outcome of the one before was taken. `end`: how long the file is.
  void begin(PageRecord record, std::uint64_t end);
  bool begun() const noexcept { return begun_; }
  // Begun, and the outcome can be taken without waiting.
  bool ended();
  // Of what was begun; waits for it. 0, or an errno: then `failed` gets the pages back.
  int take_outcome(Pages& failed);
  const Pages& pages() const noexcept { return record_.pages; }

 private:
  void run() noexcept;

  const CommitFiles files_;
  bool names_durable_ = false;
  bool begun_ = false;  // of the writer's thread
  PageRecord record_;   // written by the writer's thread while !begun_
  std::uint64_t end_ = 0;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool working_ = false;
  bool leaving_ = false;
  int error_ = 0;
  std::thread thread_;
};

}  // namespace bolo::capture
