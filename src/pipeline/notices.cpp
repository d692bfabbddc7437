#include "src/pipeline/notices.hpp"

#include <iterator>
#include <utility>

namespace bolo::pipeline {

void Notices::report(bool warning, std::string text, std::string_view event) {
  const std::lock_guard lock(mutex_);
  if (text == last_) return;
  last_ = text;
  if (waiting_.size() == kMost) waiting_.pop_front();
  waiting_.push_back({warning, std::move(text), event});
}

void Notices::forget_last() {
  const std::lock_guard lock(mutex_);
  last_.clear();
}

std::vector<Notice> Notices::take() {
  const std::lock_guard lock(mutex_);
  const std::deque<Notice> taken = std::exchange(waiting_, {});
  return {std::make_move_iterator(taken.begin()), std::make_move_iterator(taken.end())};
}

}  // namespace bolo::pipeline
