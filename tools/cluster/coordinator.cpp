#include "tools/cluster/coordinator.hpp"

#include <algorithm>
#include <numeric>

namespace bolo::tools::cluster {
namespace {

int urgency(Role role) {
  if (role == Role::kClosing) return 0;
  return role == Role::kPrelude ? 1 : 2;
}

}  // namespace

Coordinator::Coordinator(Work& work, int ranks, double silence_s)
    : work_(work),
      silence_s_(silence_s),
      states_(work.pieces().size(), State::kOpen),
      attempts_(work.pieces().size(), 0),
      order_(work.pieces().size()),
      ranks_(static_cast<std::size_t>(ranks)) {
  ranks_.front().present = true;
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  std::ranges::stable_sort(order_, {}, [this](std::size_t i) { return urgency(work_.pieces()[i].role); });
  left_ = states_.size();
  for (std::size_t i = 0; i < states_.size(); ++i) {
    if (work_.done(i)) end(i, State::kDone);
  }
  before_ = states_.size() - left_;
}

bool Coordinator::over(std::size_t piece) const {
  return states_[piece] == State::kDone || states_[piece] == State::kFailed;
}

void Coordinator::end(std::size_t piece, State state) {
  if (!over(piece)) --left_;
  states_[piece] = state;
  searched_ = false;
}

void Coordinator::open(std::size_t piece) {
  if (over(piece)) ++left_;
  states_[piece] = State::kOpen;
  searched_ = false;
  first_ = 0;
}

void Coordinator::heard(int rank, double now_s) {
  Rank& r = ranks_[static_cast<std::size_t>(rank)];
  r.present = true;
  r.heard_s = now_s;
}

void Coordinator::did(int rank, std::size_t piece, double now_s) {
  heard(rank, now_s);
  end(piece, State::kDone);
  Rank& r = ranks_[static_cast<std::size_t>(rank)];
  if (r.piece == piece) r.piece.reset();
}

void Coordinator::failed(int rank, std::size_t piece, const Error& error, double now_s) {
  heard(rank, now_s);
  Rank& r = ranks_[static_cast<std::size_t>(rank)];
  if (r.piece != piece) return;  // of a piece that went to another one meanwhile
  r.piece.reset();
  if (states_[piece] != State::kRunning) return;
  error.kind == ErrorKind::kBadInput ? drop_group(piece, error) : give_back(piece, error);
}

void Coordinator::lost(int rank) {
  Rank& r = ranks_[static_cast<std::size_t>(rank)];
  if (!r.present || rank == 0) return;
  r.present = false;
  ++ranks_lost_;
  if (!r.piece) return;
  const std::size_t piece = *r.piece;
  r.piece.reset();
  if (states_[piece] != State::kRunning) return;
  give_back(piece, Error{ErrorKind::kFailed, "the ranks that worked on it were lost"});
}

std::vector<int> Coordinator::look(double now_s) {
  std::vector<int> silent;
  for (std::size_t i = 1; i < ranks_.size(); ++i) {
    if (ranks_[i].present && now_s - ranks_[i].heard_s > silence_s_) silent.push_back(static_cast<int>(i));
  }
  for (const int rank : silent) lost(rank);
  return silent;
}

// Open again, with those of its needs that are no longer done: a file may have been damaged meanwhile.
void Coordinator::give_back(std::size_t piece, const Error& error) {
  if (attempts_[piece] >= kAttempts) return drop_group(piece, error);
  open(piece);
  ++again_;
  for (const std::size_t need : work_.pieces()[piece].needs) {
    if (states_[need] == State::kDone && !work_.done(need)) open(need);
  }
}

void Coordinator::drop_group(std::size_t piece, const Error& error) {
  failures_.push_back({piece, error});
  const std::size_t group = work_.pieces()[piece].group;
  for (std::size_t i = 0; i < states_.size(); ++i) {
    if (work_.pieces()[i].group == group && states_[i] != State::kDone) end(i, State::kFailed);
  }
}

bool Coordinator::ready(std::size_t piece) const {
  if (states_[piece] != State::kOpen) return false;
  const auto& needs = work_.pieces()[piece].needs;
  return std::ranges::all_of(needs, [this](std::size_t need) { return states_[need] == State::kDone; });
}

std::optional<std::size_t> Coordinator::next(int rank) {
  Rank& r = ranks_[static_cast<std::size_t>(rank)];
  if (r.piece || !r.present || searched_) return std::nullopt;
  while (first_ < order_.size() && over(order_[first_])) ++first_;
  const auto found = std::find_if(order_.begin() + static_cast<std::ptrdiff_t>(first_), order_.end(),
                                  [this](std::size_t piece) { return ready(piece); });
  searched_ = found == order_.end();
  if (searched_) return std::nullopt;
  states_[*found] = State::kRunning;
  ++attempts_[*found];
  r.piece = *found;
  return *found;
}

}  // namespace bolo::tools::cluster
