// Ranks as threads that talk through mailboxes: what mpirun's ranks do, with deaths where a test wants them.
#include "tools/cluster/crew.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <vector>

#include "tests/tools/cluster/fake_work.hpp"
#include "tools/cluster/job.hpp"

namespace bolo::tools::cluster {
namespace {

using namespace std::chrono_literals;
using test::captures_of;
using test::Disk;
using test::FakeWork;
using Json = nlohmann::json;

struct Post {
  std::mutex mutex;
  std::map<int, std::deque<Message>> boxes;
  std::set<int> dead;        // nothing comes from them, nothing reaches them
  std::map<int, bool> left;  // who took leave, and whether of all
};

// A death of a thread's rank: it falls silent for good, wherever it is.
struct Death {};

class MailMessenger final : public Messenger {
 public:
  MailMessenger(Post& post, int rank, int size) : post_(post), rank_(rank), size_(size) {}
  int rank() const override { return rank_; }
  int size() const override { return size_; }
  int local() const override { return 1; }
  void send(int to, const std::string& text) override {
    const std::lock_guard lock(post_.mutex);
    if (!post_.dead.contains(rank_) && !post_.dead.contains(to)) post_.boxes[to].push_back({rank_, text});
  }
  std::optional<Message> receive() override {
    const std::lock_guard lock(post_.mutex);
    if (post_.dead.contains(rank_)) throw Death{};
    auto& box = post_.boxes[rank_];
    if (box.empty()) return std::nullopt;
    Message message = std::move(box.front());
    box.pop_front();
    return message;
  }
  void leave(bool all_present) override {
    const std::lock_guard lock(post_.mutex);
    post_.left[rank_] = all_present;
  }

 private:
  Post& post_;
  int rank_;
  int size_;
};

class FakeJob final : public Job {
 public:
  FakeJob(Disk& disk, std::vector<Piece> pieces, std::chrono::milliseconds takes)
      : work_(disk, std::move(pieces), takes) {}
  Json here() const override { return {{"isas", {"AVX2"}}}; }
  Result<Json> decide(const std::vector<Json>& others) override {
    heard = others.size();
    if (!decision) return tl::unexpected(decision.error());
    return Json{{"isa", "AVX2"}};
  }
  Result<Work*> prepare(const Json& given, int /*local*/) override {
    if (!prepared) return tl::unexpected(prepared.error());
    return given.value("isa", "") == "AVX2" ? Result<Work*>(&work_) : failed("no decision");
  }

  Status decision;
  Status prepared;
  std::size_t heard = 0;

 private:
  FakeWork work_;
};

class Crew : public testing::Test {
 protected:
  // Runs `size` ranks to their ends; the result of rank 0. Ranks in `late` start nothing at all.
  Result<std::optional<CrewResult>> run(int size, const std::vector<Piece>& pieces, std::chrono::milliseconds takes,
                                        const std::set<int>& never = {}) {
    std::vector<std::jthread> others;
    jobs_.clear();
    for (int rank = 0; rank < size; ++rank) {
      jobs_.push_back(std::make_unique<FakeJob>(disk_, pieces, takes));
      if (prepare_) prepare_(rank, *jobs_.back());
    }
    for (int rank = 1; rank < size; ++rank) {
      if (never.contains(rank)) continue;
      others.emplace_back([this, rank, size] {
        MailMessenger messenger(post_, rank, size);
        ranks_[std::this_thread::get_id()] = rank;
        try {
          const auto result = take_part(*jobs_[static_cast<std::size_t>(rank)], messenger, options_, no_progress);
          if (!result) errors_[rank] = result.error().message;
        } catch (const Death&) {
        }
      });
    }
    MailMessenger messenger(post_, 0, size);
    auto result = take_part(*jobs_[0], messenger, options_, no_progress);
    others.clear();
    return result;
  }

  static Told no_progress(const Work& /*work*/) { return {}; }

  void kill(int rank) {
    const std::lock_guard lock(post_.mutex);
    post_.dead.insert(rank);
  }

  // std::map with a lock: written by each thread once.
  template <typename Key, typename Value>
  class Shared {
   public:
    Value& operator[](const Key& key) {
      const std::lock_guard lock(mutex_);
      return map_[key];
    }
    std::size_t size() {
      const std::lock_guard lock(mutex_);
      return map_.size();
    }

   private:
    std::mutex mutex_;
    std::map<Key, Value> map_;
  };

  Disk disk_;
  Post post_;
  CrewOptions options_{0.5, nullptr};
  Shared<std::thread::id, int> ranks_;
  Shared<int, std::string> errors_;
  std::function<void(int, FakeJob&)> prepare_;
  std::vector<std::unique_ptr<FakeJob>> jobs_;
};

TEST_F(Crew, SharesTheWorkAndDoesEachPieceOnce) {
  const auto pieces = captures_of(3, 6, true);
  const auto result = run(4, pieces, 3ms);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ((*result)->did, pieces.size());
  EXPECT_EQ((*result)->again, 0U);
  EXPECT_EQ(disk_.runs.size(), pieces.size());
  std::size_t pieces_of_ranks = 0;
  for (const RankShare& rank : (*result)->ranks) {
    EXPECT_GT(rank.pieces, 0U);
    EXPECT_FALSE(rank.lost);
    EXPECT_GT(rank.busy_s, 0.0);
    pieces_of_ranks += rank.pieces;
  }
  EXPECT_EQ(pieces_of_ranks, pieces.size());
  EXPECT_EQ(jobs_[0]->heard, 3U);
  EXPECT_EQ(post_.left, (std::map<int, bool>{{0, true}, {1, true}, {2, true}, {3, true}}));
}

TEST_F(Crew, OneRankAloneDoesAll) {
  const auto pieces = captures_of(1, 3, true);
  const auto result = run(1, pieces, 0ms);
  ASSERT_TRUE(result);
  EXPECT_EQ(disk_.runs.size(), pieces.size());
}

TEST_F(Crew, ARankThatDiesCostsOnePiece) {
  const auto pieces = captures_of(2, 10, false);
  std::atomic<bool> died{false};
  disk_.on_run = [&](std::size_t) {
    const int rank = ranks_[std::this_thread::get_id()];
    if (rank == 2 && !died.exchange(true)) {
      kill(2);
      throw Death{};
    }
  };
  const auto result = run(4, pieces, 5ms);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(disk_.done.size(), pieces.size());
  EXPECT_EQ(disk_.runs.size(), pieces.size());
  EXPECT_EQ((*result)->again, 1U);
  EXPECT_TRUE((*result)->ranks[2].lost);
  EXPECT_EQ(post_.left, (std::map<int, bool>{{0, false}, {1, false}, {3, false}})) << "not of all: one is missing";
}

TEST_F(Crew, ARankThatNeverComesIsNotWaitedForLonger) {
  const auto pieces = captures_of(1, 4, false);
  const auto result = run(3, pieces, 1ms, {2});
  ASSERT_TRUE(result);
  EXPECT_EQ(jobs_[0]->heard, 1U);
  EXPECT_EQ(disk_.runs.size(), pieces.size());
  EXPECT_TRUE((*result)->ranks[2].lost);
}

TEST_F(Crew, WithoutRankZeroTheOthersEnd) {
  disk_.on_run = [&](std::size_t) {
    if (ranks_[std::this_thread::get_id()] != 0) return;
    kill(0);
    throw Death{};
  };
  EXPECT_THROW((void)run(3, captures_of(1, 9, false), 5ms), Death);
  for (const int rank : {1, 2}) {
    EXPECT_NE(errors_[rank].find("rank 0 has been silent"), std::string::npos) << errors_[rank];
  }
}

TEST_F(Crew, ARankThatCannotTakePartIsNotNeeded) {
  prepare_ = [](int rank, FakeJob& job) {
    if (rank == 1) job.prepared = bad_input("this host sees no captures");
  };
  options_.silence_s = 30.0;
  const auto start = std::chrono::steady_clock::now();
  const auto result = run(3, captures_of(1, 8, false), 2ms);
  ASSERT_TRUE(result);
  EXPECT_TRUE((*result)->ranks[1].lost);
  EXPECT_EQ(errors_[1], "this host sees no captures");
  EXPECT_LT(std::chrono::steady_clock::now() - start, 10s) << "it said so: nobody waits for the silence";
}

TEST_F(Crew, WhatRankZeroRefusesEndsAll) {
  prepare_ = [](int rank, FakeJob& job) {
    if (rank == 0) job.decision = bad_input("no instruction set in common");
  };
  const auto result = run(3, captures_of(1, 8, false), 2ms);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(errors_[1], "");
  EXPECT_TRUE(disk_.runs.empty());
  EXPECT_TRUE(post_.left[2]) << "all are there, and take leave of each other";
}

TEST_F(Crew, FailuresAreToldWithTheirHostAndDoNotEndTheOthers) {
  disk_.bad = {1};
  const auto pieces = captures_of(2, 4, false);
  const auto result = run(3, pieces, 1ms);
  ASSERT_TRUE(result);
  ASSERT_EQ((*result)->failures.size(), 1U);
  EXPECT_EQ((*result)->failures[0].piece, 1U);
  EXPECT_NE((*result)->failures[0].error.message.find("bad piece"), std::string::npos);
  EXPECT_TRUE(disk_.done.contains(9)) << "the other capture's output";
}

TEST_F(Crew, WhatBreaksOnceIsDoneAgain) {
  disk_.breaks = {{2, 1}, {5, 2}};
  const auto pieces = captures_of(2, 4, false);
  const auto result = run(2, pieces, 1ms);
  ASSERT_TRUE(result);
  EXPECT_TRUE((*result)->failures.empty());
  EXPECT_EQ((*result)->again, 3U);
  EXPECT_EQ(disk_.done.size(), pieces.size());
}

TEST_F(Crew, EndsWhenTheUserSaysSo) {
  std::atomic<bool> stop{false};
  options_.stop = &stop;
  disk_.on_run = [&](std::size_t piece) { stop = stop || piece == 3; };
  const auto result = run(3, captures_of(1, 30, false), 2ms);
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find("goes on from there"), std::string::npos);
  EXPECT_LT(disk_.runs.size(), 30U);
}

}  // namespace
}  // namespace bolo::tools::cluster
