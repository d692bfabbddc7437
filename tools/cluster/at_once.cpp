#include "tools/cluster/at_once.hpp"

#include <algorithm>
#include <mutex>
#include <numeric>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <vector>

namespace bolo::tools::cluster {
namespace {

class AtOnce {
 public:
  AtOnce(Work& work, const Shard& shard, std::size_t threads, const Beat& beat,
         const std::function<void(std::size_t)>& told)
      : work_(work), beat_(beat), told_(told), shares_(shares_of(work, shard)), running_(threads, 0) {}

  // One thread's part; its own number among them.
  void take_part(std::size_t thread) {
    while (const auto piece = next()) {
      if (work_.done(*piece)) {
        was_done();
        continue;
      }
      const Status status = work_.run(*piece, [&](std::uint64_t done) { return beat(thread, done); });
      finish(thread, *piece, status);
    }
  }

  // When all have ended.
  bool ended() const { return ended_; }
  ShardResult take_result() { return std::move(result_); }

 private:
  std::optional<std::size_t> next() {
    const std::lock_guard lock(mutex_);
    while (!ended_ && next_ < shares_.size()) {
      const std::size_t piece = shares_[next_++];
      if (!broken_.contains(work_.pieces()[piece].group)) return piece;
    }
    return std::nullopt;
  }

  void was_done() {
    const std::lock_guard lock(mutex_);
    ++result_.before;
  }

  bool beat(std::size_t thread, std::uint64_t done) {
    const std::lock_guard lock(mutex_);
    running_[thread] = done;
    ended_ = ended_ || !beat_(std::accumulate(running_.begin(), running_.end(), std::uint64_t{0}));
    return !ended_;
  }

  void finish(std::size_t thread, std::size_t piece, const Status& status) {
    const std::lock_guard lock(mutex_);
    running_[thread] = 0;
    if (status) {
      result_.did.push_back(piece);
      if (told_) told_(piece);
    } else if (!ended_) {
      result_.failures.push_back({piece, status.error()});
      broken_.insert(work_.pieces()[piece].group);
    }
  }

  Work& work_;
  const Beat& beat_;
  const std::function<void(std::size_t)>& told_;
  const std::vector<std::size_t> shares_;
  std::mutex mutex_;  // of all below
  std::vector<std::uint64_t> running_;
  std::size_t next_ = 0;
  bool ended_ = false;
  std::set<std::size_t> broken_;
  ShardResult result_;
};

}  // namespace

Result<ShardResult> run_shard_at_once(Work& work, const Shard& shard, int threads, const Beat& beat,
                                      const std::function<void(std::size_t)>& told) {
  const auto count = static_cast<std::size_t>(std::max(threads, 1));
  AtOnce at_once(work, shard, count, beat, told);
  {
    std::vector<std::jthread> all;
    all.reserve(count);
    for (std::size_t i = 0; i < count; ++i) all.emplace_back([&at_once, i] { at_once.take_part(i); });
  }
  if (at_once.ended()) return tl::unexpected(interruption());
  ShardResult result = at_once.take_result();
  result.left = pieces_left(work);
  return result;
}

}  // namespace bolo::tools::cluster
