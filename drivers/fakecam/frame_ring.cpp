#include "drivers/fakecam/frame_ring.hpp"

namespace bolo::fakecam {

FrameRing::FrameRing(std::size_t ahead, std::size_t keep, std::size_t pixels)
    : frames_(ahead + keep), pins_(ahead + keep, 0), ahead_(ahead) {
  for (auto& frame : frames_) frame.counts.resize(pixels);
}

WireFrame* FrameRing::begin_write() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return closed_ || (written_ < sent_ + ahead_ && pins_[slot(written_)] == 0); });
  if (closed_) return nullptr;
  if (written_ >= frames_.size()) oldest_ = written_ - frames_.size() + 1;
  return &frames_[slot(written_)];
}

void FrameRing::end_write() {
  {
    const std::lock_guard lock(mutex_);
    frames_[slot(written_)].sequence = written_;
    ++written_;
  }
  changed_.notify_all();
}

void FrameRing::finish() {
  {
    const std::lock_guard lock(mutex_);
    finished_ = true;
  }
  changed_.notify_all();
}

const WireFrame* FrameRing::begin_send() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return closed_ || finished_ || sent_ < written_; });
  if (closed_ || sent_ == written_) return nullptr;
  visible_ = sent_ + 1;
  return &frames_[slot(sent_)];
}

void FrameRing::end_send() {
  {
    const std::lock_guard lock(mutex_);
    ++sent_;
  }
  changed_.notify_all();
}

FrameRing::Pin FrameRing::find(std::uint16_t block_id) {
  const std::lock_guard lock(mutex_);
  for (std::uint64_t s = visible_; s > oldest_; --s) {
    if (frames_[slot(s - 1)].block.block_id != block_id) continue;
    ++pins_[slot(s - 1)];
    return Pin(*this, &frames_[slot(s - 1)]);
  }
  return Pin(*this, nullptr);
}

FrameRing::Pin::~Pin() {
  if (frame_ == nullptr) return;
  {
    const std::lock_guard lock(ring_.mutex_);
    --ring_.pins_[ring_.slot(frame_->sequence)];
  }
  ring_.changed_.notify_all();
}

void FrameRing::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  changed_.notify_all();
}

}  // namespace bolo::fakecam
