// The soak's own bookkeeping: finds moments at which camera's and daemon's books can be compared, and compares them.
#pragma once

#include <deque>
#include <limits>
#include <optional>

#include "tools/lab/soak/account.hpp"
#include "tools/lab/soak/result.hpp"
#include "tools/lab/soak/rig.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak {

// Thread: one at a time.
class Books {
 public:
  Books(double period_s, Findings& findings) : period_s_(period_s), findings_(findings) {}

  // Takes up what the camera told, and makes a mark of it as soon as its frame has settled.
  void look(const CameraBook& camera, const Watcher& watcher, double now_s);

  double last_mark_s() const { return last_ ? last_->at_s : -std::numeric_limits<double>::infinity(); }
  // The sums from the first mark to the last.
  void close(const faults::Losses& lost, SoakResult& result) const;

 private:
  struct Waiting {
    CameraAccount account;
    Mark mark;  // the camera's part
  };
  void compare(const Mark& mark);

  double period_s_;
  Findings& findings_;
  std::deque<Waiting> waiting_;
  std::optional<Mark> first_;
  std::optional<Mark> last_;
  std::int64_t unheard_ = 0;
  std::uint64_t balances_ = 0;
};

}  // namespace bolo::tools::soak
