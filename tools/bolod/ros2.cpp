#include "tools/bolod/ros2.hpp"

#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <ctime>
#include <filesystem>

#include <fmt/format.h>

#include "src/core/clock.hpp"

namespace bolo::daemon {
namespace {

constexpr std::int64_t kPauseNs = 2'000'000'000;    // between starts
constexpr std::int64_t kStableNs = 60'000'000'000;  // run time after which an end is logged again
constexpr timespec kPoll{0, 10'000'000};
constexpr int kPolls = 100;  // time to end by itself
constexpr double kMostDomain = 232.0;

// Beside this program (build folder) or installed; empty: neither.
std::filesystem::path program() {
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  for (const std::filesystem::path& file : {folder / "bolo-ros2", folder.parent_path() / "libexec/bolo/bolo-ros2"}) {
    if (access(file.c_str(), X_OK) == 0) return file;
  }
  return {};
}

}  // namespace

void Ros2Options::declare(model::KeyTable& keys) {
  keys.section(
      "ros2",
      "topics of ROS 2 (package bolo-ros2): /NAME/image_raw, /NAME/image_deblurred, /NAME/camera_info; in NAME '_' for "
      "what ROS 2 has no place for");
  keys.boolean("enable", enabled, "Publish topics with sensor-data quality of service (best effort). Needs [shm].");
  keys.boolean("kelvin", kelvin, "Images in kelvin (32FC1) instead of shared memory's counts (mono16).");
  keys.text("frame_id", frame_id, "Coordinate frame (frame_id) of the messages; empty: NAME.");
  keys.integer("domain", domain, {0.0, kMostDomain, ""}, "ROS_DOMAIN_ID of the reading nodes.");
}

Status Ros2Options::check(const model::KeyTable& keys, bool has_shared_memory) const {
  if (!enabled) return {};
  const std::string place = keys.where("ros2.enable");
  if (!has_shared_memory) return bad_input(place + "ros2.enable needs shm.enable = true");
  if (program().empty()) return bad_input(place + "ros2.enable: bolo-ros2 is missing; install the package bolo-ros2");
  return {};
}

Ros2Process::Ros2Process(const Ros2Options& options, const std::string& name) {
  if (!options.enabled) return;
  words_ = {program().string(), "--with-parent", "--domain", std::to_string(options.domain)};
  if (options.kelvin) words_.emplace_back("--kelvin");
  if (!options.frame_id.empty()) words_.push_back("--frame-id=" + options.frame_id);
  words_.insert(words_.end(), {"--", name});  // may begin with a '-'
}

Ros2Process::~Ros2Process() {
  if (pid_ <= 0) return;
  kill(pid_, SIGTERM);
  for (int i = 0; i < kPolls; ++i) {
    if (waitpid(pid_, nullptr, WNOHANG) != 0) return;
    nanosleep(&kPoll, nullptr);
  }
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

void Ros2Process::poll(const std::function<void(const std::string&)>& warn) {
  if (words_.empty()) return;
  const std::int64_t now = monotonic_ns();
  int status = 0;
  if (pid_ > 0) {
    if (now - started_ns_ > kStableNs) warned_ = false;
    if (waitpid(pid_, &status, WNOHANG) == 0) return;
    pid_ = -1;
    const std::string end = WIFSIGNALED(status) ? fmt::format("by signal {}", WTERMSIG(status))
                                                : fmt::format("with exit code {}", WEXITSTATUS(status));
    if (!warned_) warn("bolo-ros2 ended " + end + "; it is started again");
    warned_ = true;
  }
  if (started_ns_ == 0 || now - started_ns_ >= kPauseNs) start(warn);
}

// Without fork(), after which the deblurring threads would fault on every page that they write.
void Ros2Process::start(const std::function<void(const std::string&)>& warn) {
  started_ns_ = monotonic_ns();
  std::vector<char*> arguments;
  for (std::string& word : words_) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  posix_spawnattr_t attributes{};
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);  // the daemon blocks the signals that end it
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
  const int error = posix_spawn(&pid_, words_.front().c_str(), nullptr, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  if (error == 0) return;
  pid_ = -1;
  if (!warned_) warn(fmt::format("{} does not start: {}", words_.front(), std::strerror(error)));
  warned_ = true;
}

}  // namespace bolo::daemon
