// Cost of shared-memory readers to the writer: its rate and latency with 0, 1, 4 and 16 of them, each a process that
// reads through libbolo-client.
#include <sched.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <ctime>
#include <memory>
#include <numeric>
#include <thread>

#include "bolo/client.h"
#include "drivers/shm/shm_sink.hpp"
#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/stats.hpp"
#include "src/rt/thread.hpp"
#include "tools/lab/bench/bench.hpp"

namespace bolo::tools {
namespace {

constexpr Geometry kStreamed{640, 120};
constexpr std::int64_t kPeriodNs = 5'000'000;
constexpr int kWarmUpFrames = 30;
constexpr int kFrames = 200;  // measured in each phase
constexpr int kFreezeAt = kWarmUpFrames + kFrames / 4;
constexpr int kKillAt = kWarmUpFrames + kFrames / 2;
constexpr std::array<int, 4> kReaders{0, 1, 4, 16};
constexpr int kOpenTimeout_ms = 10'000;
constexpr int kFrameTimeout_ms = 2000;
constexpr timespec kSlowReadersPause{0, 10 * kPeriodNs};

enum class Manner { kPlain, kFrozen, kKilled, kSlow };

// With four readers or more, one is frozen, one killed and one slow; a single one just reads.
Manner manner_of(int reader, int readers) {
  if (readers < 4 || reader > 2) return Manner::kPlain;
  return std::array{Manner::kFrozen, Manner::kKilled, Manner::kSlow}[static_cast<std::size_t>(reader)];
}

// A reader's reports to the writer's process, in shared memory.
struct ReaderState {
  rt::Gauge<bool> ready;
  rt::Counter frames;
};

// In a child: copies every frame until the writer ends.
int read_all(const std::string& name, Manner manner, ReaderState& state) {
  const sched_param ordinary{};
  sched_setscheduler(0, SCHED_OTHER, &ordinary);
  bolo_client* client = nullptr;
  if (bolo_client_open(name.c_str(), kOpenTimeout_ms, &client) != BOLO_CLIENT_OK) return 1;
  std::vector<std::uint16_t> raw(kStreamed.pixels());
  std::vector<std::uint16_t> deblurred(kStreamed.pixels());
  bolo_client_frame frame{};
  state.ready.set(true);
  while (bolo_client_next(client, kFrameTimeout_ms, &frame) == BOLO_CLIENT_OK) {
    if (bolo_client_copy(&frame, raw.data(), deblurred.data()) == BOLO_CLIENT_OK) state.frames.add();
    if (manner == Manner::kSlow) nanosleep(&kSlowReadersPause, nullptr);
  }
  bolo_client_close(client);
  return 0;
}

class Readers {
 public:
  Readers(const std::string& name, int count) : count_(static_cast<std::size_t>(count)) {
    void* memory = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return;
    states_ = new (memory) std::array<ReaderState, kMost>();
    for (std::size_t i = 0; i < count_; ++i) {
      const pid_t child = fork();
      if (child == 0) _exit(read_all(name, manner(i), (*states_)[i]));
      if (child > 0) processes_.push_back(child);
    }
  }
  ~Readers() {
    for (const pid_t process : processes_) kill(process, SIGKILL);
    for (const pid_t process : processes_) waitpid(process, nullptr, 0);
    if (states_ != nullptr) munmap(states_, kBytes);
  }
  Readers(const Readers&) = delete;
  Readers& operator=(const Readers&) = delete;

  Status wait_until_ready() const {
    const std::int64_t deadline_ns = monotonic_ns() + std::int64_t{kOpenTimeout_ms} * 1'000'000;
    if (processes_.size() != count_) return failed("cannot start " + std::to_string(count_) + " reader processes");
    for (std::size_t i = 0; i < count_; ++i) {
      while (!(*states_)[i].ready.value()) {
        if (monotonic_ns() > deadline_ns) return failed("a reader process did not open the shared memory in time");
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    }
    return {};
  }

  void signal(Manner to, int number) const {
    for (std::size_t i = 0; i < count_; ++i) {
      if (manner(i) == to) kill(processes_[i], number);
    }
  }

  double frames_read() const {
    double sum = 0.0;
    double readers = 0.0;
    for (std::size_t i = 0; i < count_; ++i) {
      if (manner(i) != Manner::kPlain) continue;
      sum += static_cast<double>((*states_)[i].frames.value());
      readers += 1.0;
    }
    return readers > 0.0 ? sum / readers : 0.0;
  }

 private:
  static constexpr std::size_t kMost = 16;
  static constexpr std::size_t kBytes = sizeof(std::array<ReaderState, kMost>);

  Manner manner(std::size_t reader) const { return manner_of(static_cast<int>(reader), static_cast<int>(count_)); }

  std::size_t count_;
  std::array<ReaderState, kMost>* states_ = nullptr;
  std::vector<pid_t> processes_;
};

// A sink that publishes two planes alternately.
class Writer {
 public:
  Status open(const std::string& name) {
    pipeline::SinkFormat format;
    format.source.format.geometry = kStreamed;
    format.source.format.frame_period_s = static_cast<double>(kPeriodNs) / kNsPerSecond;
    format.solver_text = "bench";
    sink_ = std::make_unique<shm::ShmSink>(shm::ShmOptions{name, 0, 0600, ""});
    for (std::vector<std::uint16_t>& plane : planes_) {
      plane.resize(kStreamed.pixels());
      std::iota(plane.begin(), plane.end(), static_cast<std::uint16_t>(&plane - planes_.data()));
    }
    return sink_->open(format);
  }
  void publish(std::uint64_t id) noexcept {
    const FrameMeta meta{id, monotonic_ns(), monotonic_ns(), 0};
    sink_->publish({meta, monotonic_ns(), planes_[id % 2].data(), planes_[(id + 1) % 2].data()}, stats_);
  }

 private:
  pipeline::FrameInlet inlet_{StreamFormat{{1, 1}, PixelType::kUint16, {}, 0.005, 1}, 1, 1};
  pipeline::PipelineStats stats_{inlet_};
  std::unique_ptr<shm::ShmSink> sink_;
  std::array<std::vector<std::uint16_t>, 2> planes_;
};

void sleep_until(std::int64_t ns) {
  const timespec when{ns / 1'000'000'000, ns % 1'000'000'000};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &when, nullptr) == EINTR) {
  }
}

struct Phase {
  double rate_hz = 0.0;
  double publish_us_p50 = 0.0;
  double publish_us_p99 = 0.0;
  double due_us_p99 = 0.0;
  double read_fraction = 0.0;
};

Phase pace(Writer& writer, const Readers& readers) {
  std::vector<double> publish_us;
  std::vector<double> due_us;
  publish_us.reserve(kFrames);
  due_us.reserve(kFrames);
  std::int64_t due_ns = monotonic_ns() + kPeriodNs;
  std::int64_t first_ns = 0;
  std::int64_t last_ns = 0;
  for (int i = 0; i <= kWarmUpFrames + kFrames; ++i, due_ns += kPeriodNs) {
    sleep_until(due_ns);
    const std::int64_t begin_ns = monotonic_ns();
    writer.publish(static_cast<std::uint64_t>(i));
    last_ns = monotonic_ns();
    if (i == kFreezeAt) readers.signal(Manner::kFrozen, SIGSTOP);  // right after a frame: while it is being read
    if (i == kKillAt) readers.signal(Manner::kKilled, SIGKILL);
    if (i == kWarmUpFrames) first_ns = last_ns;
    if (i <= kWarmUpFrames) continue;
    publish_us.push_back(static_cast<double>(last_ns - begin_ns) * 1e-3);
    due_us.push_back(static_cast<double>(last_ns - due_ns) * 1e-3);
  }
  sleep_until(due_ns);  // readers have a period for the last frame, too
  Phase phase;
  phase.rate_hz = kFrames / (static_cast<double>(last_ns - first_ns) / kNsPerSecond);
  phase.publish_us_p50 = quantile(publish_us, 0.50);
  phase.publish_us_p99 = quantile(publish_us, 0.99);
  phase.due_us_p99 = quantile(due_us, 0.99);
  phase.read_fraction = readers.frames_read() / (kWarmUpFrames + kFrames + 1);
  return phase;
}

Result<Phase> run_phase(int count, int priority) {
  const std::string name = "bench-" + std::to_string(getpid());
  const Readers readers(name, count);  // forks before the writer starts a thread
  Writer writer;
  RETURN_IF_ERROR(writer.open(name));
  RETURN_IF_ERROR(readers.wait_until_ready());
  const sched_param ordinary{};
  (void)rt::apply_to_this_thread({"", priority});
  const Phase phase = pace(writer, readers);
  sched_setscheduler(0, SCHED_OTHER, &ordinary);
  return phase;
}

// Medians over rounds; ratios are to the phase without readers of the same round.
Json measured(int readers, const std::vector<Phase>& phases, const std::vector<Phase>& alone) {
  const auto of_manner = [readers](Manner manner) {
    int count = 0;
    for (int i = 0; i < readers; ++i) count += manner_of(i, readers) == manner ? 1 : 0;
    return count;
  };
  const auto typical = [&](double Phase::*figure) { return quantile(mapped(phases, figure), 0.5); };
  const auto ratio = [&](double Phase::*figure) {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < phases.size(); ++i) ratios.push_back(phases[i].*figure / alone[i].*figure);
    return quantile(ratios, 0.5);
  };
  return {{"readers", readers},
          {"frozen", of_manner(Manner::kFrozen)},
          {"killed", of_manner(Manner::kKilled)},
          {"slow", of_manner(Manner::kSlow)},
          {"rate_hz", typical(&Phase::rate_hz)},
          {"publish_us_p50", typical(&Phase::publish_us_p50)},
          {"publish_us_p99", typical(&Phase::publish_us_p99)},
          {"due_us_p99", typical(&Phase::due_us_p99)},
          {"rate_ratio", ratio(&Phase::rate_hz)},
          {"publish_p99_ratio", ratio(&Phase::publish_us_p99)},
          {"due_p99_ratio", ratio(&Phase::due_us_p99)},
          {"read_fraction", typical(&Phase::read_fraction)}};
}

}  // namespace

Result<Json> bench_readers(double seconds, int priority) {
  const unsigned processors = std::thread::hardware_concurrency();
  const bool realtime = priority > 0 && rt::apply_to_this_thread({"", priority}).has_value();
  std::array<std::vector<Phase>, kReaders.size()> phases;
  const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(seconds * kNsPerSecond);
  std::size_t rounds = 0;
  for (; rounds == 0 || monotonic_ns() < end_ns; ++rounds) {
    for (std::size_t i = 0; i < kReaders.size(); ++i) {
      // Each round starts with another case, so that drifts of the machine's load affect all of them.
      const std::size_t which = (i + rounds) % kReaders.size();
      ASSIGN_OR_RETURN(const auto phase, run_phase(kReaders[which], priority));
      phases[which].push_back(phase);
    }
  }
  const std::string method =
      "one writer of 640x120 frames at 200 Hz (" + std::string(realtime ? "SCHED_FIFO" : "default scheduler") + ", " +
      std::to_string(processors) +
      " processors); readers are processes that copy every frame through libbolo-client. Of 4 and 16 readers one is "
      "stopped, one killed while they read, one reads a tenth. Phases of " +
      std::to_string(kFrames) + " frames in turn, " + std::to_string(rounds) +
      " rounds: medians; ratios within a round to its phase without readers";
  Json report{{"method", method},
              {"rounds", rounds},
              {"frames_per_phase", kFrames},
              {"processors", processors},
              {"realtime", realtime}};
  for (std::size_t i = 0; i < kReaders.size(); ++i) {
    report["cases"].push_back(measured(kReaders[i], phases[i], phases[0]));
  }
  return report;
}

}  // namespace bolo::tools
