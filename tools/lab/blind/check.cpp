#include "tools/lab/blind/check.hpp"

#include <cstdlib>

#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include <glib.h>

#include "tools/lab/blind/captures.hpp"
#include "tools/lab/blind/child.hpp"
#include "tools/lab/blind/go_on.hpp"

namespace bolo::tools::blind {
namespace {

constexpr const char* kInterrupted = "interrupted; nothing was scored";

// A folder that only this user can enter, named after nothing; removed with all in it.
class PrivateFolder {
 public:
  static Result<PrivateFolder> make(const std::filesystem::path& parent) {
    std::string name = (std::filesystem::absolute(parent) / "bolo-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) {
      return failed(parent.string() + ": no folder can be made there; choose another with TMPDIR or --keep");
    }
    return PrivateFolder(name);
  }
  PrivateFolder(PrivateFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  PrivateFolder& operator=(PrivateFolder&&) = delete;
  ~PrivateFolder() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  const std::filesystem::path& path() const { return path_; }

  // Gives it a name instead of removing it.
  Status keep_as(const std::filesystem::path& target, Replace replace) {
    std::error_code error;
    if (replace == Replace::kExisting) std::filesystem::remove_all(target, error);
    std::filesystem::rename(path_, target, error);
    // Somebody else has just kept the same session there, which is as good.
    if (error == std::errc::directory_not_empty || error == std::errc::file_exists) return {};
    if (error) return failed(target.string() + ": cannot be made: " + error.message());
    path_.clear();
    return {};
  }

 private:
  explicit PrivateFolder(std::filesystem::path path) : path_(std::move(path)) {}
  std::filesystem::path path_;
};

// The work of all jobs; next() and add() may be called by any of them.
class Board {
 public:
  Board(const std::vector<Session>& sessions, const std::function<void(std::size_t)>& done)
      : sessions_(sessions), trials_(sessions.size()), done_(done) {}

  const Session* next(std::size_t& place) {
    const std::lock_guard lock(mutex_);
    if (error_ || next_ == sessions_.size()) return nullptr;
    place = next_++;
    return &sessions_[place];
  }

  void add(std::size_t place, Trial trial) {
    const std::lock_guard lock(mutex_);
    trials_[place] = std::move(trial);
    done_(++finished_);
  }

  void fail(Error error) {
    const std::lock_guard lock(mutex_);
    if (!error_) error_ = std::move(error);
  }

  Result<std::vector<Trial>> result() {
    if (error_) return tl::unexpected(*error_);
    return std::move(trials_);
  }

 private:
  const std::vector<Session>& sessions_;
  std::vector<Trial> trials_;
  const std::function<void(std::size_t)>& done_;
  std::mutex mutex_;
  std::size_t next_ = 0;
  std::size_t finished_ = 0;
  std::optional<Error> error_;
};

// What the score can hold: a broken diagnosis may have said anything.
std::string readable(const std::string& text) {
  const std::unique_ptr<char, decltype(&g_free)> valid(g_utf8_make_valid(text.data(), static_cast<gssize>(text.size())),
                                                       &g_free);
  return valid.get();
}

// Simulates and diagnoses one session in a private folder. A diagnosis that broke is a trial without a finding;
// kFailed: the disk, the simulator, or `go_on` said no.
Result<Trial> run_trial(const Session& session, const CheckOptions& options, const GoOn& go_on) {
  const auto started = std::chrono::steady_clock::now();
  bool ended = false;
  const GoOn wanted = [&] {
    ended = ended || !go_on();
    return !ended;
  };
  std::error_code error;
  const auto parent = options.keep.empty() ? std::filesystem::temp_directory_path(error) : options.keep;
  if (error) return failed("TMPDIR: is no folder: " + error.message());
  auto folder = PrivateFolder::make(parent);
  if (!folder) return tl::unexpected(folder.error());
  auto captures = write_captures(session, folder->path(), wanted);
  if (!captures) return ended ? failed(kInterrupted) : tl::unexpected(captures.error());
  const ChildWork work{options.program, std::move(*captures), folder->path() / "report", session.withheld};
  const Status ran = run_child(work, wanted);
  if (!wanted()) return failed(kInterrupted);
  Trial trial{session, std::nullopt, {}, 0.0};
  auto finding = ran ? read_finding(work.folder / "report.json") : tl::unexpected(ran.error());
  if (finding) {
    trial.finding = std::move(*finding);
  } else {
    trial.error = readable(finding.error().message);
  }
  trial.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  if (options.keep.empty()) return trial;
  const Status kept = folder->keep_as(kept_folder(session, options), options.replace);
  if (!kept) return tl::unexpected(kept.error());
  return trial;
}

void work(Board& board, const CheckOptions& options, const std::atomic<bool>& stop) {
  std::size_t place = 0;
  while (const Session* session = board.next(place)) {
    auto trial = run_trial(*session, options, [&stop] { return !stop.load(std::memory_order_relaxed); });
    if (trial) {
      board.add(place, std::move(*trial));
    } else {
      board.fail(std::move(trial.error()));
    }
  }
}

}  // namespace

std::filesystem::path kept_folder(const Session& session, const CheckOptions& options) {
  return options.keep / (std::string(name_of(session.kind)) + '-' + std::to_string(session.index));
}

KeptAnswers kept_answers(const CheckOptions& options) {
  return {options.keep / "answers.json", options.keep / "nonce.txt", options.keep / "seal.txt"};
}

Result<std::vector<Trial>> run_trials(const std::vector<Session>& sessions, const CheckOptions& options,
                                      const std::function<void(std::size_t)>& done, const std::atomic<bool>& stop) {
  Board board(sessions, done);
  {
    std::vector<std::jthread> jobs;
    jobs.reserve(static_cast<std::size_t>(std::max(options.jobs, 0)));
    for (int i = 0; i < options.jobs; ++i) {
      jobs.emplace_back([&board, &options, &stop] { work(board, options, stop); });
    }
  }
  return board.result();
}

}  // namespace bolo::tools::blind
