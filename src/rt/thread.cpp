#include "src/rt/thread.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>

#include <cstring>
#include <system_error>

#include "src/core/threads.hpp"

namespace bolo::rt {
namespace {

constexpr std::size_t kShownName = 15;  // TASK_COMM_LEN without its end

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

// 0.1 to 0.2 ms: a solver that prepares with its team calls it forty times a frame, up to 0.05 ms apart, and waking a
// thread takes 0.02.
constexpr int kSpins = 10'000;

void relax() noexcept {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

// A signal must not end the wait.
void wait(sem_t& sem, int spins) noexcept {
  for (; spins > 0; --spins, relax()) {
    if (sem_trywait(&sem) == 0) return;
  }
  while (sem_wait(&sem) != 0) continue;
}

ThreadOptions named(const ThreadOptions& options, int worker) {
  ThreadOptions own = options;
  if (!own.name.empty()) own.name.append("-").append(std::to_string(worker));
  return own;
}

}  // namespace

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
  gates_ = std::make_unique<Gate[]>(helpers);
  for (std::size_t i = 0; i < helpers; ++i) sem_init(&gates_[i].start, 0, 0);
  sem_init(&done_, 0, 0);
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
  for (std::size_t i = 0; i < threads_.size(); ++i) wait(done_, 0);  // each has applied its options
  for (const Status& result : applied) {
    if (!result && status_) status_ = result;
  }
}

WorkerTeam::~WorkerTeam() {
  job_ = nullptr;
  for (std::size_t i = 0; i < threads_.size(); ++i) sem_post(&gates_[i].start);
  for (std::thread& thread : threads_) thread.join();
  sem_destroy(&done_);
}

void WorkerTeam::run(Job job, void* context, bool more) noexcept {
  job_ = job;
  context_ = context;
  more_ = more;
  for (std::size_t i = 0; i < threads_.size(); ++i) sem_post(&gates_[i].start);
  job(context, 0);
  for (std::size_t i = 0; i < threads_.size(); ++i) wait(done_, spins_);
}

void WorkerTeam::work(int worker, const ThreadOptions& options, Status& applied) noexcept {
  applied = apply_to_this_thread(options);
  sem_post(&done_);
  sem_t& start = gates_[static_cast<std::size_t>(worker) - 1].start;
  for (int spins = 0; wait(start, spins), job_ != nullptr;) {
    job_(context_, worker);
    spins = more_ ? spins_ : 0;
    sem_post(&done_);
  }
}

void TeamCrew::run(int rows, void (*work)(void*, int, int) noexcept, void* self) noexcept {
  constexpr int kFewestRows = 8;  // less is done before the others are awake
  struct Call {
    void (*work)(void*, int, int) noexcept;
    void* self;
    int rows;
    int parts;
  } call{work, self, rows, team_.size()};
  if (call.parts == 1 || rows < kFewestRows) return work(self, 0, rows);
  team_.run(
      [](void* context, int worker) {
        const Call& c = *static_cast<const Call*>(context);
        c.work(c.self, c.rows * worker / c.parts, c.rows * (worker + 1) / c.parts);
      },
      &call, true);
}

}  // namespace bolo::rt
