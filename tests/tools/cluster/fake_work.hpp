// Work in memory, for ranks that are threads: pieces that are done, or break, as a test says.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "tools/cluster/work.hpp"

namespace bolo::tools::cluster::test {

// What all ranks see: the disk.
struct Disk {
  std::mutex mutex;
  std::set<std::size_t> done;
  std::vector<std::size_t> runs;                 // every run that came to its end, in that order
  std::map<std::size_t, int> breaks;             // a piece fails so often before it works
  std::set<std::size_t> bad;                     // nobody can do it
  std::function<void(std::size_t)> on_run = {};  // at its start, unlocked
};

class FakeWork final : public Work {
 public:
  FakeWork(Disk& disk, std::vector<Piece> pieces, std::chrono::milliseconds takes = std::chrono::milliseconds(0))
      : disk_(disk), pieces_(std::move(pieces)), takes_(takes) {}

  const std::vector<Piece>& pieces() const override { return pieces_; }
  bool done(std::size_t piece) const override {
    const std::lock_guard lock(disk_.mutex);
    return disk_.done.contains(piece);
  }
  Status run(std::size_t piece, const Beat& beat) override {
    if (disk_.on_run) disk_.on_run(piece);
    const auto end = std::chrono::steady_clock::now() + takes_;
    do {
      if (!beat(0)) return failed("told to end");
      if (takes_.count() > 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    } while (std::chrono::steady_clock::now() < end);
    const std::lock_guard lock(disk_.mutex);
    for (const std::size_t need : pieces_[piece].needs) {
      if (!disk_.done.contains(need)) return failed("needs are missing");
    }
    if (disk_.bad.contains(piece)) return bad_input("bad piece");
    if (disk_.breaks[piece]-- > 0) return failed("broken piece");
    disk_.done.insert(piece);
    disk_.runs.push_back(piece);
    return {};
  }

 private:
  Disk& disk_;
  std::vector<Piece> pieces_;
  std::chrono::milliseconds takes_;
};

// `captures` of `blocks` blocks each; with `walks` each block but the first needs a walk, and this the walk before.
inline std::vector<Piece> captures_of(std::size_t captures, std::size_t blocks, bool walks) {
  std::vector<Piece> pieces;
  for (std::size_t c = 0; c < captures; ++c) {
    const std::size_t first = pieces.size();
    for (std::size_t k = 1; walks && k < blocks; ++k) {
      Piece walk{"walk", c, Role::kPrelude, 0, {}};
      if (k > 1) walk.needs.push_back(pieces.size() - 1);
      pieces.push_back(walk);
    }
    Piece output{"output", c, Role::kClosing, 0, {}};
    for (std::size_t k = 0; k < blocks; ++k) {
      Piece block{"block", c, Role::kShare, 100, {}};
      if (walks && k > 0) block.needs.push_back(first + k - 1);
      output.needs.push_back(pieces.size());
      pieces.push_back(block);
    }
    pieces.push_back(output);
  }
  return pieces;
}

}  // namespace bolo::tools::cluster::test
