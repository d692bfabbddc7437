#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include "src/rt/thread.hpp"
#include "tests/refusal.hpp"

namespace bolo::rt::worker_team_test {

TEST(WorkerTeam, RunsEachPartOnce) {
  for (const int workers : {1, 2, 5}) {
    WorkerTeam team(workers, {});
    ASSERT_TRUE(team.status());
    ASSERT_EQ(team.size(), workers);
    for (const int parts : {1, workers, 9}) {
      std::array<int, 9> calls{};
      team.run(
          parts, [](void* context, int part) { ++static_cast<int*>(context)[part]; }, calls.data());
      EXPECT_EQ(std::count(calls.begin(), calls.begin() + parts, 1), parts) << workers;
      EXPECT_EQ(std::count(calls.begin() + parts, calls.end(), 0), 9 - parts) << workers;
    }
  }
}

// Not atomic: only the team orders the rounds, which the thread sanitizer checks.
TEST(WorkerTeam, TwentyThousandRoundsAreOneAfterTheOther) {
  constexpr int kMostParts = 7;
  constexpr long kRounds = 20'000;
  WorkerTeam team(3, {});
  struct Shared {
    std::array<long, kMostParts> sum{};
    long input = 0;
  } shared;
  std::array<long, kMostParts> expected{};
  for (long round = 0; round < kRounds; ++round) {
    shared.input = round;
    const auto parts = static_cast<std::size_t>(1 + round % kMostParts);  // fewer or more than in the round before
    team.run(
        static_cast<int>(parts),
        [](void* context, int part) {
          auto& s = *static_cast<Shared*>(context);
          s.sum[static_cast<std::size_t>(part)] += s.input;
        },
        &shared, round % 3 != 0);
    for (std::size_t i = 0; i < parts; ++i) expected[i] += round;
    ASSERT_EQ(shared.sum, expected) << round;
  }
}

// The started thread holds one part until the others are done: they do not wait for it.
TEST(WorkerTeam, NobodyWaitsForAWorkerThatIsHeldUp) {
  constexpr int kParts = 8;
  struct Shared {
    std::thread::id caller = std::this_thread::get_id();
    std::atomic<int> by_caller{0};
    std::atomic<bool> helped{false};
  };
  WorkerTeam team(2, {});
  for (int round = 0; round < 20; ++round) {
    Shared shared;
    team.run(
        kParts,
        [](void* context, int /*part*/) {
          auto& s = *static_cast<Shared*>(context);
          if (std::this_thread::get_id() == s.caller) {
            s.by_caller.fetch_add(1);
            while (s.by_caller.load() == kParts - 1 && !s.helped.load()) std::this_thread::yield();
          } else {
            s.helped.store(true);
            const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
            while (s.by_caller.load() < kParts - 1 && std::chrono::steady_clock::now() < end) std::this_thread::yield();
          }
        },
        &shared);
    ASSERT_EQ(shared.by_caller.load(), kParts - 1) << round;
  }
}

// Applied options would stay on the test's own thread.
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

// Requests a priority without the right to one, and exits.
[[noreturn]] void ask_without_privileges() {
  const rlimit none{0, 0};
  setrlimit(RLIMIT_RTPRIO, &none);
  if (geteuid() == 0 && setuid(65534) != 0) std::_Exit(3);
  const Status status = apply_to_this_thread({.name = "bolo-deblur", .realtime_priority = 20});
  std::fprintf(stderr, "%s\n", status ? "granted" : status.error().message.c_str());
  std::_Exit(status ? 0 : status.error().exit_code());
}

// In a child: root, as which the test may run, is never refused.
TEST(ApplyToThisThread, ARefusedPriorityNamesTheLimitToRaise) {
  EXPECT_EXIT(ask_without_privileges(), testing::ExitedWithCode(2),
              "thread 'bolo-deblur': SCHED_FIFO priority 20 refused .*, RLIMIT_RTPRIO is 0; set LimitRTPRIO=20 in the "
              "systemd unit, or 'ulimit -r 20'");
}

}  // namespace bolo::rt::worker_team_test
