#include "src/rt/worker_team.hpp"

#include <gtest/gtest.h>

#include <pthread.h>

#include <array>
#include <set>
#include <string>
#include <vector>

namespace bolo::rt {
namespace {

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

TEST(WorkerTeam, FewerThanOneWorkerIsOne) {
  WorkerTeam team(0, {});
  EXPECT_EQ(team.size(), 1);
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
        &shared);
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

TEST(WorkerTeam, TellsARefusalAndWorksOn) {
  WorkerTeam team(2, {.name = "solve", .realtime_priority = 0, .cpus = {1023}});
  ASSERT_FALSE(team.status());
  EXPECT_NE(team.status().error().message.find("thread 'solve-1': CPUs 1023 refused"), std::string::npos)
      << team.status().error().message;
  int calls = 0;
  team.run(
      [](void* context, int worker) {
        if (worker == 1) ++*static_cast<int*>(context);
      },
      &calls);
  EXPECT_EQ(calls, 1);
}

}  // namespace
}  // namespace bolo::rt
