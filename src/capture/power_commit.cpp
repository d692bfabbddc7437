#include "src/capture/power_commit.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include "src/core/output_file.hpp"

namespace bolo::capture {
namespace {

// Without room for the record the pages are written unprotected: frames are worth more.
bool write_journal(int journal, const PageRecord& record, bool power) {
  const std::vector<std::byte> bytes = to_bytes(record);
  const bool written = write_all(journal, 0, bytes.size(), bytes.data());  // C2
  if (written && (!power || ::fdatasync(journal) == 0)) return true;       // C3
  return (errno == ENOSPC || errno == EDQUOT || errno == EFBIG) && ::ftruncate(journal, 0) == 0;
}

}  // namespace

int commit_pages(const CommitFiles& files, const PageRecord& record, std::uint64_t end, SurvivesCut survives) {
  const bool power = survives == SurvivesCut::kPower;
  if (power && ::fdatasync(files.file) != 0) return errno;  // C1
  if (record.pages.empty()) return 0;
  if (!write_journal(files.journal, record, power)) return errno;
  return write_pages(files.file, record.pages, end) ? 0 : errno;  // C4
}

PowerCommit::PowerCommit(CommitFiles files) : files_(std::move(files)), thread_([this] { run(); }) {}

PowerCommit::~PowerCommit() {
  {
    const std::lock_guard lock(mutex_);
    leaving_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void PowerCommit::begin(PageRecord record, std::uint64_t end) {
  record_ = std::move(record);
  end_ = end;
  begun_ = true;
  {
    const std::lock_guard lock(mutex_);
    working_ = true;
  }
  changed_.notify_all();
}

bool PowerCommit::ended() {
  const std::lock_guard lock(mutex_);
  return begun_ && !working_;
}

int PowerCommit::take_outcome(Pages& failed) {
  int error = 0;
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return !working_; });
    error = std::exchange(error_, 0);
  }
  if (error != 0) failed.merge(record_.pages);
  record_.pages.clear();
  begun_ = false;
  return error;
}

void PowerCommit::run() noexcept {
  for (;;) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return working_ || leaving_; });
      if (!working_) return;
    }
    names_durable_ = names_durable_ || sync_folder_of(files_.name);
    const int error = names_durable_ ? commit_pages(files_, record_, end_, SurvivesCut::kPower) : errno;
    {
      const std::lock_guard lock(mutex_);
      error_ = error;
      working_ = false;
    }
    changed_.notify_all();
  }
}

}  // namespace bolo::capture
