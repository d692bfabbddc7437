#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include "src/rt/thread.hpp"
#include "tests/refusal.hpp"

namespace bolo::rt::worker_team_test {

TEST(WorkerTeam, RunsTheJobOnceOnEachWorkerAndEachOnItsOwnThread) {
  for (const int workers : {1, 2, 5}) {
    WorkerTeam team(workers, {});
    ASSERT_TRUE(team.status());
    ASSERT_EQ(team.size(), workers);
    struct Seen {
      std::array<int, 5> calls{};
      std::array<std::thread::id, 5> thread{};
    } seen;
    team.run(
        [](void* context, int worker) {
          auto& s = *static_cast<Seen*>(context);
          ++s.calls[static_cast<std::size_t>(worker)];
          s.thread[static_cast<std::size_t>(worker)] = std::this_thread::get_id();
        },
        &seen);
    std::set<std::thread::id> threads;
    for (std::size_t w = 0; w < static_cast<std::size_t>(workers); ++w) {
      EXPECT_EQ(seen.calls[w], 1);
      threads.insert(seen.thread[w]);
    }
    EXPECT_EQ(threads.size(), static_cast<std::size_t>(workers));
    EXPECT_EQ(seen.thread[0], std::this_thread::get_id());
  }
}

// Plain, not atomic: the barrier alone orders the rounds, which the thread sanitizer checks.
TEST(WorkerTeam, TenThousandRoundsMeetAtTheBarrier) {
  constexpr int kWorkers = 3;
  constexpr long kRounds = 10'000;
  WorkerTeam team(kWorkers, {});
  struct Shared {
    std::array<long, kWorkers> sum{};
    long input = 0;
  } shared;
  long expected = 0;
  for (long round = 0; round < kRounds; ++round) {
    shared.input = round;
    team.run(
        [](void* context, int worker) {
          auto& s = *static_cast<Shared*>(context);
          s.sum[static_cast<std::size_t>(worker)] += s.input;
        },
        &shared, round % 3 != 0);
    expected += round;
    for (const long sum : shared.sum) ASSERT_EQ(sum, expected);
  }
}

TEST(WorkerTeam, NamesItsThreads) {
  WorkerTeam team(2, {.name = "solve"});
  std::array<char, 16> name{};
  team.run(
      [](void* context, int worker) {
        if (worker == 1) pthread_getname_np(pthread_self(), static_cast<char*>(context), 16);
      },
      name.data());
  EXPECT_STREQ(name.data(), "solve-1");
}

// The options would stay on the thread that runs the tests.
void on_own_thread(const std::function<void()>& check) { std::thread(check).join(); }

TEST(ApplyToThisThread, CutsLongNamesToWhatTheKernelShows) {
  on_own_thread([] {
    ASSERT_TRUE(apply_to_this_thread({.name = "a-name-of-twenty-one"}));
    std::array<char, 16> name{};
    pthread_getname_np(pthread_self(), name.data(), name.size());
    EXPECT_STREQ(name.data(), "a-name-of-twent");
  });
}

TEST(ApplyToThisThread, PlacesTheThread) {
  on_own_thread([] {
    cpu_set_t allowed;
    ASSERT_EQ(pthread_getaffinity_np(pthread_self(), sizeof allowed, &allowed), 0);
    int cpu = 0;
    while (!CPU_ISSET(static_cast<std::size_t>(cpu), &allowed)) ++cpu;
    ASSERT_TRUE(apply_to_this_thread({.name = "", .realtime_priority = 0, .cpus = {cpu}}));
    cpu_set_t now;
    ASSERT_EQ(pthread_getaffinity_np(pthread_self(), sizeof now, &now), 0);
    EXPECT_EQ(CPU_COUNT(&now), 1);
    EXPECT_TRUE(CPU_ISSET(static_cast<std::size_t>(cpu), &now));
  });
}

TEST(ApplyToThisThread, RefusesWhatCannotBe) {
  for (const int priority : {-1, 100}) {
    expect_refused(apply_to_this_thread({.name = "t", .realtime_priority = priority}), {"1 to 99"});
  }
  for (const int cpu : {-1, 1 << 20}) {
    const ThreadOptions options{.name = "t", .realtime_priority = 0, .cpus = {cpu}};
    expect_error(apply_to_this_thread(options), {"CPU " + std::to_string(cpu)});
  }
}

// Asks for a priority as a process that may have none, and ends.
[[noreturn]] void ask_without_privileges() {
  const rlimit none{0, 0};
  setrlimit(RLIMIT_RTPRIO, &none);
  if (geteuid() == 0 && setuid(65534) != 0) std::_Exit(3);
  const Status status = apply_to_this_thread({.name = "bolo-deblur", .realtime_priority = 20});
  std::fprintf(stderr, "%s\n", status ? "granted" : status.error().message.c_str());
  std::_Exit(status ? 0 : status.error().exit_code());
}

// In a child: the test program itself may be root, which is never refused.
TEST(ApplyToThisThread, ARefusedPriorityNamesTheLimitToRaise) {
  EXPECT_EXIT(ask_without_privileges(), testing::ExitedWithCode(2),
              "thread 'bolo-deblur': SCHED_FIFO priority 20 refused .*, RLIMIT_RTPRIO is 0; set LimitRTPRIO=20 in the "
              "systemd unit, or 'ulimit -r 20'");
}

}  // namespace bolo::rt::worker_team_test
