#include "src/rt/thread.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <system_error>

#include "src/core/threads.hpp"

namespace bolo::rt {
namespace {

constexpr std::size_t kShownName = 15;  // TASK_COMM_LEN without the terminating zero

std::string quoted(const ThreadOptions& options) { return "thread '" + options.name + "'"; }

Status apply_priority(const ThreadOptions& options) {
  const int priority = options.realtime_priority;
  if (priority == 0) return {};
  const std::string asked = quoted(options) + ": SCHED_FIFO priority " + std::to_string(priority);
  if (priority < 1 || priority > 99) return bad_input(asked + " is out of range; give 1 to 99, or 0 for none");
  sched_param param{};
  param.sched_priority = priority;
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
  if (error == 0) return {};
  rlimit limit{};
  getrlimit(RLIMIT_RTPRIO, &limit);
  const std::string number = std::to_string(priority);
  return bad_input(asked + " refused (" + std::strerror(error) + "), RLIMIT_RTPRIO is " +
                   std::to_string(limit.rlim_cur) + "; set LimitRTPRIO=" + number +
                   " in the systemd unit, or 'ulimit -r " + number + "'");
}

Status apply_affinity(const ThreadOptions& options) {
  if (options.cpus.empty()) return {};
  cpu_set_t set;
  CPU_ZERO(&set);
  std::string list;
  for (const int cpu : options.cpus) {
    if (cpu < 0 || cpu >= CPU_SETSIZE) {
      return bad_input(quoted(options) + ": CPU " + std::to_string(cpu) + " is out of range; see 'nproc --all'");
    }
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    list.append(list.empty() ? "" : ",").append(std::to_string(cpu));
  }
  const int error = pthread_setaffinity_np(pthread_self(), sizeof set, &set);
  if (error == 0) return {};
  return bad_input(quoted(options) + ": CPUs " + list + " refused (" + std::strerror(error) +
                   "); choose online CPUs that the cpuset allows (AllowedCPUs= of the systemd unit)");
}

// 0.1 to 0.2 ms: a solver that prepares with its team calls run() 40 times a frame, 0.05 ms apart; waking takes 0.02.
constexpr int kSpins = 10'000;

void relax() noexcept {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

// Waits until the value differs from `old`, and returns it.
template <typename T>
T wait_for_change(const std::atomic<T>& value, T old, int spins) noexcept {
  for (; spins > 0; --spins, relax()) {
    if (const T now = value.load(std::memory_order_acquire); now != old) return now;
  }
  value.wait(old, std::memory_order_acquire);
  return value.load(std::memory_order_acquire);
}

ThreadOptions named(const ThreadOptions& options, int worker) {
  ThreadOptions own = options;
  if (!own.name.empty()) own.name.append("-").append(std::to_string(worker));
  return own;
}

}  // namespace

int configured_cpus() noexcept { return static_cast<int>(sysconf(_SC_NPROCESSORS_CONF)); }

Status check_cpus(const std::vector<int>& cpus, int configured) {
  for (const int cpu : cpus) {
    if (cpu < configured) continue;
    return bad_input("pipeline.cpus names CPU " + std::to_string(cpu) + ", which this computer has not");
  }
  return {};
}

Status apply_to_this_thread(const ThreadOptions& options) {
  if (!options.name.empty()) pthread_setname_np(pthread_self(), options.name.substr(0, kShownName).c_str());
  Status priority = apply_priority(options);
  Status affinity = apply_affinity(options);
  if (!priority && !affinity) return bad_input(priority.error().message + "; " + affinity.error().message);
  return priority ? affinity : priority;
}

WorkerTeam::WorkerTeam(int workers, const ThreadOptions& options)
    : spins_(static_cast<unsigned>(workers) <= std::thread::hardware_concurrency() ? kSpins : 0) {
  const auto helpers = static_cast<std::size_t>(workers > 1 ? workers - 1 : 0);
  shares_ = std::make_unique<Share[]>(helpers + 1);
  threads_.reserve(helpers);
  std::vector<Status> applied(helpers);
  try {
    for (std::size_t i = 0; i < helpers; ++i) {
      const int worker = static_cast<int>(i) + 1;
      threads_.emplace_back(
          [this, worker, own = named(options, worker), &result = applied[i]] { work(worker, own, result); });
    }
  } catch (const std::system_error& e) {
    status_ = failed("worker thread " + std::to_string(threads_.size() + 1) + " of " + std::to_string(helpers) + ": " +
                     describe_exception(e));
  }
  for (int ready = 0; ready < size() - 1;) ready = wait_for_change(done_, ready, 0);  // all have set their options
  for (const Status& result : applied) {
    if (!result && status_) status_ = result;
  }
}

WorkerTeam::~WorkerTeam() {
  ended_.store(true, std::memory_order_relaxed);
  round_.fetch_add(1);
  round_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void WorkerTeam::run(int parts, Job job, void* context, bool more) noexcept {
  parts_.store(parts, std::memory_order_release);
  job_.store(job, std::memory_order_release);
  context_.store(context, std::memory_order_release);
  more_.store(more, std::memory_order_relaxed);
  done_.store(0, std::memory_order_relaxed);
  const std::uint32_t round = round_.load(std::memory_order_relaxed) + 1;
  const std::uint64_t number = std::uint64_t{round} << 32U;
  for (int w = 0; w < size(); ++w) {
    const auto first = static_cast<std::uint64_t>(parts * w / size());
    shares_[static_cast<std::size_t>(w)].next.store(number | first, std::memory_order_release);
  }
  round_.store(round);
  round_.notify_all();
  take_parts(0);
  for (int done = done_.load(std::memory_order_acquire); done < parts;) done = wait_for_change(done_, done, spins_);
  for (int w = 0; w < size(); ++w) {
    shares_[static_cast<std::size_t>(w)].next.store(number | kClosed, std::memory_order_relaxed);
  }
}

// First the parts of the worker's own share that nobody has taken, then the others'.
void WorkerTeam::take_parts(int worker) noexcept {
  for (int i = 0; i < size(); ++i) take_share((worker + i) % size());
}

void WorkerTeam::take_share(int of) noexcept {
  std::atomic<std::uint64_t>& share = shares_[static_cast<std::size_t>(of)].next;
  std::uint64_t next = share.load(std::memory_order_acquire);
  for (;;) {
    const int parts = parts_.load(std::memory_order_acquire);
    const Job job = job_.load(std::memory_order_acquire);
    void* const context = context_.load(std::memory_order_acquire);
    const std::uint64_t part = next & kClosed;
    if (part >= static_cast<std::uint64_t>(parts * (of + 1) / size())) return;
    if (!share.compare_exchange_weak(next, next + 1, std::memory_order_acq_rel, std::memory_order_acquire)) continue;
    job(context, static_cast<int>(part));
    if (done_.fetch_add(1) + 1 == parts) done_.notify_one();
    ++next;
  }
}

void WorkerTeam::work(int worker, const ThreadOptions& options, Status& applied) noexcept {
  applied = apply_to_this_thread(options);
  done_.fetch_add(1);
  done_.notify_one();
  std::uint32_t round = 0;
  for (;;) {
    round = wait_for_change(round_, round, more_.load(std::memory_order_relaxed) ? spins_ : 0);
    if (ended_.load(std::memory_order_relaxed)) return;
    take_parts(worker);
  }
}

void WorkerTeam::run(int rows, Parts parts, Work job, void* self) noexcept {
  constexpr int kFewestRows = 8;    // fewer are done before the other threads wake
  constexpr int kPartsAWorker = 8;  // for Parts::kMany
  struct Call {
    Work job;
    void* self;
    int rows;
    int parts;
  } call{job, self, rows, std::min(rows, size() * (parts == Parts::kMany ? kPartsAWorker : 1))};
  if (size() == 1 || rows < kFewestRows) return job(self, 0, rows);
  run(
      call.parts,
      [](void* context, int part) {
        const Call& c = *static_cast<const Call*>(context);
        c.job(c.self, c.rows * part / c.parts, c.rows * (part + 1) / c.parts);
      },
      &call, true);
}

}  // namespace bolo::rt
