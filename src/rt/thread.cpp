#include "src/rt/thread.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>

#include <cstring>

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

}  // namespace

Status apply_to_this_thread(const ThreadOptions& options) {
  if (!options.name.empty()) pthread_setname_np(pthread_self(), options.name.substr(0, kShownName).c_str());
  Status priority = apply_priority(options);
  Status affinity = apply_affinity(options);
  if (!priority && !affinity) return bad_input(priority.error().message + "; " + affinity.error().message);
  return priority ? affinity : priority;
}

}  // namespace bolo::rt
