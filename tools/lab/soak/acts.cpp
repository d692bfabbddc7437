#include "tools/lab/soak/acts.hpp"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "src/core/clock.hpp"
#include "tools/lab/soak/reader.hpp"

namespace bolo::tools::soak {
namespace {

constexpr int kSlowReader_ms = 50;
constexpr double kHelperEnd_s = 20.0;
constexpr double kReaderBegin_s = 20.0;
constexpr double kFullAfter_s = 0.8;                // of frames, on the disk that gets full
constexpr std::uint64_t kLeastDisk = 2U << 20U;     // bytes: what a capture takes before its first frame, and more
constexpr std::uint64_t kMostMemory = 1ULL << 29U;  // bytes
constexpr double kClockStep_s = 2.0;

std::uint64_t available_memory() {
  std::ifstream in("/proc/meminfo");
  std::string key;
  std::uint64_t kib = 0;
  for (std::string unit; in >> key >> kib; std::getline(in, unit)) {
    if (key == "MemAvailable:") return kib << 10U;
  }
  return 0;
}

// Or until it has taken too long.
void wait_for_first_frame(Process& reader) {
  const std::int64_t limit_ns = monotonic_ns() + static_cast<std::int64_t>(kReaderBegin_s * kNsPerSecond);
  while (monotonic_ns() < limit_ns && !reader.ended() && last_account(reader.log().string() + ".out").frames == 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

}  // namespace

void Acts::begin(const Disturbance& d) {
  switch (d.kind) {
    case Kind::kCameraStopped:
      return rig_.camera().signal(SIGSTOP);
    case Kind::kDaemonStopped:
      return rig_.daemon().signal(SIGSTOP);
    case Kind::kDaemonKilled:
      return rig_.daemon().signal(SIGKILL);
    case Kind::kReaderKilled:
      return rig_.readers().front().signal(SIGKILL);
    case Kind::kReaderStopped:
      return rig_.readers().front().signal(SIGSTOP);
    case Kind::kReaderSlow:
      return start_helper(rig_.reader("slow-reader-" + std::to_string(++count_), kSlowReader_ms));
    case Kind::kRecording:
      return record(d, RecordingEnd::kInterrupted);
    case Kind::kRecorderKilled:
      return record(d, RecordingEnd::kKilled);
    case Kind::kDiskFull:
      return record(d, RecordingEnd::kDiskFull);
    case Kind::kClockStep:
      return step_clock(kClockStep_s);
    case Kind::kCpuTaken:
      return take_processors(d.for_s);
    case Kind::kMemoryTaken:
      return take_memory(d.for_s);
    case Kind::kReload:
      return write_config(true);
    case Kind::kBadReload:
      return write_config(false);
    case Kind::kCorrection: {
      const std::filesystem::path log = rig_.file("nuc-" + std::to_string(++count_));
      jobs_.add([this, log] { correct_and_judge(rig_.programs(), rig_.name(), log, findings_); });
      return;
    }
    default:
      return;
  }
}

void Acts::end(const Disturbance& d) {
  switch (d.kind) {
    case Kind::kCameraStopped:
      return rig_.camera().signal(SIGCONT);
    case Kind::kDaemonStopped:
      return rig_.daemon().signal(SIGCONT);
    case Kind::kReaderStopped:
      return rig_.readers().front().signal(SIGCONT);
    case Kind::kReaderKilled:
      if (Status done = rig_.replace_reader(); !done) findings_.broken(Invariant::kProcesses, done.error().message);
      return;
    case Kind::kReaderSlow:
      return end_helper(true);
    case Kind::kClockStep:
      return step_clock(-kClockStep_s);
    case Kind::kBadReload:
      if (Status done = write_daemon_file(rig_.daemon_file()); !done) {
        findings_.broken(Invariant::kCommands, done.error().message);
      }
      return;
    case Kind::kCpuTaken:
    case Kind::kMemoryTaken:
      return end_helper(false);
    default:
      return;
  }
}

void Acts::record(const Disturbance& d, RecordingEnd end) {
  RecordingJob job;
  job.programs = rig_.programs();
  job.daemon = rig_.name();
  job.file = rig_.file("recording-" + std::to_string(++count_) + ".h5");
  job.truth = &rig_.truth();
  job.end = end;
  job.seconds = d.for_s;
  if (end == RecordingEnd::kDiskFull) {
    const RigRequest& rig = rig_.request();
    const double bytes = kFullAfter_s * rig.rate_hz * static_cast<double>(rig.geometry.pixels() * 2);
    job.most_bytes = std::max(kLeastDisk, static_cast<std::uint64_t>(bytes));
  }
  jobs_.add([this, job] { record_and_judge(job, findings_); });
}

void Acts::take_processors(double seconds) {
  if (rig_.programs().stress.empty()) return jobs_.add([seconds] { soak::take_processors(seconds); });
  const auto all = std::to_string(std::max(1U, std::thread::hardware_concurrency()));
  start_helper({{rig_.programs().stress, "--quiet", "--cpu", all}, rig_.file("stress")});
}

void Acts::take_memory(double seconds) {
  const std::uint64_t bytes = std::min(available_memory() / 4, kMostMemory);
  if (rig_.programs().stress.empty()) return jobs_.add([=] { soak::take_memory(seconds, bytes); });
  start_helper(
      {{rig_.programs().stress, "--quiet", "--vm", "1", "--vm-bytes", std::to_string(bytes)}, rig_.file("stress")});
}

void Acts::start_helper(const Command& command) {
  auto started = Process::start(command);
  if (!findings_.require(Invariant::kProcesses, started.has_value(), started ? "" : started.error().message)) return;
  helper_.emplace(std::move(*started));
}

// How long it takes to end must not hold up the schedule; nor, on a busy machine, how long a reader takes to begin.
void Acts::end_helper(bool must_be_well) {
  if (!helper_) return;
  jobs_.add([this, must_be_well, helper = std::make_shared<Process>(std::move(*helper_))] {
    if (must_be_well) wait_for_first_frame(*helper);
    helper->signal(SIGTERM);
    const auto code = helper->wait(kHelperEnd_s);
    if (!must_be_well) return;
    const ReaderAccount account = last_account(helper->log().string() + ".out");
    findings_.require(Invariant::kReaders, code == 0 && account.frames > 0 && account.disorder == 0,
                      "a slow reader: exit code " + std::to_string(code.value_or(-1)) + ", " + text_of(account));
  });
  helper_.reset();
}

// The daemon reads its file again.
void Acts::write_config(bool right) {
  DaemonFile& file = rig_.daemon_file();
  if (right) file.nuc_interval_s += 1.0;
  Status written = write_daemon_file(file);
  if (written && !right) std::ofstream(config_of(file), std::ios::app) << "\n[nuc_]\ninterval_s = 'never'\n";
  findings_.require(Invariant::kCommands, written.has_value(), written ? "" : written.error().message);
  rig_.daemon().signal(SIGHUP);
}

void Acts::step_clock(double by_s) {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  now.tv_sec += static_cast<time_t>(std::lround(by_s));
  findings_.require(Invariant::kCommands, clock_settime(CLOCK_REALTIME, &now) == 0,
                    "this computer's clock cannot be set; leave out clock_step");
}

}  // namespace bolo::tools::soak
