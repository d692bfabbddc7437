#include "tools/lab/soak/books.hpp"

#include <cstdio>

namespace bolo::tools::soak {
namespace {

constexpr std::size_t kMostWaiting = 12;  // accounts: three seconds

}  // namespace

void Books::look(const CameraBook& camera, const Watcher& watcher, double now_s) {
  const auto& present = camera.present();
  if (present && camera.quiet() && (waiting_.empty() || waiting_.back().account.time_ns != present->time_ns)) {
    waiting_.push_back({*present, camera.mark()});
    if (waiting_.size() > kMostWaiting) waiting_.pop_front();
  }
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    const auto position = watcher.find(waiting_[i].account.last_timestamp_ns, waiting_[i].account.time_ns);
    if (!position) continue;
    Mark mark = waiting_[i].mark;
    mark.at_s = now_s;
    mark.life = position->life;
    mark.number = position->number;
    mark.frame_id = position->frame_id;
    mark.published = position->published;
    mark.lost_total = position->lost;
    mark.silence_s = position->silence_s;
    compare(mark);
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(i) + 1);
    return;
  }
}

void Books::compare(const Mark& mark) {
  if (last_) {
    const Balance balance = balance_of(*last_, mark);
    check_balance(balance, mark.silence_s - last_->silence_s, period_s_, findings_);
    unheard_ += balance.unheard;
    ++balances_;
  } else {
    first_ = mark;
  }
  last_ = mark;
}

void Books::close(const faults::Losses& lost, SoakResult& result) const {
  findings_.require(Invariant::kAccount, balances_ > 0, "the books were never compared: no quiet moment");
  if (!first_) return;
  const Balance all = balance_of(*first_, *last_);
  result.passed = all.passed;
  result.published = all.published;
  result.lost = lost;
  result.unheard = unheard_;
  result.balances = balances_;
  char text[200];
  std::snprintf(text, sizeof text,
                "%llu passed = %llu published + %llu lost + %lld sent to nobody; compared %llu times",
                static_cast<unsigned long long>(all.passed), static_cast<unsigned long long>(all.published),
                static_cast<unsigned long long>(all.lost), static_cast<long long>(unheard_),
                static_cast<unsigned long long>(balances_));
  findings_.figure(Invariant::kCamera, text);
}

}  // namespace bolo::tools::soak
