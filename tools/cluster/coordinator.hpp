// Who does what: hands the pieces of shared work to ranks, and hands them out again when a rank is lost.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/cluster/shard.hpp"
#include "tools/cluster/work.hpp"

namespace bolo::tools::cluster {

// A state machine without clock, disk or network of its own: told what happened, it says what to do. Rank 0 is where it
// lives, and is never lost. Thread: any one at a time.
class Coordinator {
 public:
  // Looks once which pieces are done. `silence_s`: after it a rank that has not been heard is taken for lost.
  Coordinator(Work& work, int ranks, double silence_s);

  // What happened. A rank is idle from its first word on, and after each piece.
  void heard(int rank, double now_s);
  void did(int rank, std::size_t piece, double now_s);
  // kBadInput ends its group; kFailed is tried again, kAttempts times in all, after its needs were looked at.
  void failed(int rank, std::size_t piece, const Error& error, double now_s);
  void lost(int rank);
  // Ranks that have been silent too long: lost from now on, until they are heard again. Their pieces go to others, as
  // often as a failed one. Returns the newly lost ones.
  std::vector<int> look(double now_s);

  // What an idle rank is to do now; nothing: wait.
  std::optional<std::size_t> next(int rank);
  bool idle(int rank) const { return !ranks_[static_cast<std::size_t>(rank)].piece; }
  bool present(int rank) const { return ranks_[static_cast<std::size_t>(rank)].present; }
  // Nothing is left that could be done.
  bool finished() const { return left_ == 0; }

  const std::vector<Failure>& failures() const { return failures_; }
  std::size_t before() const { return before_; }  // pieces that were done when it began
  std::size_t again() const { return again_; }    // pieces that were handed out once more
  int ranks_lost() const { return ranks_lost_; }

  static constexpr int kAttempts = 3;

 private:
  enum class State { kOpen, kRunning, kDone, kFailed };
  struct Rank {
    bool present = false;
    double heard_s = 0.0;
    std::optional<std::size_t> piece;
  };

  bool over(std::size_t piece) const;
  void end(std::size_t piece, State state);
  void open(std::size_t piece);
  bool ready(std::size_t piece) const;
  void give_back(std::size_t piece, const Error& error);
  void drop_group(std::size_t piece, const Error& error);

  Work& work_;
  double silence_s_;
  std::vector<State> states_;
  std::vector<int> attempts_;
  std::vector<std::size_t> order_;  // closing pieces first: they make room; then preludes: others wait for them
  std::size_t first_ = 0;           // in order_; all before are over
  bool searched_ = false;           // nothing was ready, and nothing has changed since
  std::size_t left_ = 0;            // pieces that are not over
  std::vector<Rank> ranks_;
  std::vector<Failure> failures_;
  std::size_t before_ = 0;
  std::size_t again_ = 0;
  int ranks_lost_ = 0;
};

}  // namespace bolo::tools::cluster
