#include "tools/lab/soak/frame_judge.hpp"

#include "bolo/shm_layout.h"

namespace bolo::tools::soak {
namespace {

constexpr std::uint32_t kSparingFlags = BOLO_FLAG_REDUCED | BOLO_FLAG_INVERSE | BOLO_FLAG_RAW;

std::string of(const Shown& frame) {
  return "frame " + std::to_string(frame.number) + " (id " + std::to_string(frame.frame_id) + ")";
}

std::string text_of(const Manner& manner) {
  std::string text = "offset " + std::to_string(manner.offset);
  if (manner.swapped) text += ", bytes swapped";
  if (manner.metadata) text += ", other last rows";
  return text;
}

}  // namespace

void FrameJudge::begin_life() noexcept {
  last_.reset();
  before_.reset();
  settled_ = 0;
}

Grade FrameJudge::judge(const Shown& frame) {
  check_order(frame);
  const std::optional<Recognised> seen = truth_.recognise(frame.raw, scratch_);
  findings_.looked(Invariant::kRaw);
  Grade grade = Grade::kWrong;
  if (!seen) {
    findings_.broken(Invariant::kRaw, of(frame) + ": its raw plane is none of the capture's");
    settled_ = 0;
  } else if (!allowed(seen->manner)) {
    findings_.broken(Invariant::kRaw, of(frame) + ": the capture's frame " + std::to_string(seen->index) +
                                          ", but with " + text_of(seen->manner) + ", which no fault asked for");
    settled_ = 0;
  } else {
    follow(frame, *seen);
    const bool right = !seen->manner.swapped && !seen->manner.metadata &&
                       truth_.right(frame.deblurred, seen->index, seen->manner.offset);
    if (frame.flags != 0) {
      grade = (frame.flags & ~kSparingFlags) == 0 ? Grade::kSparing : Grade::kFlagged;
    } else if (right) {
      findings_.looked(Invariant::kDeblurred);
      grade = Grade::kClean;
    } else if (settled_ < window_) {
      grade = Grade::kSettling;
    } else {
      findings_.looked(Invariant::kDeblurred);
      findings_.broken(Invariant::kDeblurred, of(frame) + ": its sharp plane is not that of the capture's frame " +
                                                  std::to_string(seen->index) + " undisturbed, and no flag says so");
    }
  }
  before_ = seen;
  last_ = frame;
  last_->raw = last_->deblurred = nullptr;
  return grade;
}

void FrameJudge::check_order(const Shown& frame) {
  findings_.looked(Invariant::kOrder);
  if (!last_) return;
  const auto broken = [&](const std::string& what) { findings_.broken(Invariant::kOrder, of(frame) + ": " + what); };
  if (frame.number != last_->number + frame.missed + 1) {
    broken("follows number " + std::to_string(last_->number) + ", with " + std::to_string(frame.missed) + " between");
  }
  if (frame.frame_id <= last_->frame_id) broken("its id follows " + std::to_string(last_->frame_id));
  if (frame.publish_ns <= last_->publish_ns) broken("was published before the one before it");
  const bool new_window = (frame.flags & BOLO_FLAG_WARM_UP) != 0;
  if (frame.camera_ns <= last_->camera_ns && !new_window) {
    broken("the camera's time goes back by " + std::to_string(last_->camera_ns - frame.camera_ns) +
           " ns within a window");
  }
}

bool FrameJudge::allowed(const Manner& manner) const noexcept {
  return (!manner.swapped || allowed_.swapped) && (!manner.metadata || allowed_.metadata) &&
         (manner.offset == 0 || manner.offset == allowed_.offset);
}

// Lost frames must be flagged; what is excused is what cannot be told from the frames that came: other pixels, and a
// counter that jumps while the scene and the clock go on.
void FrameJudge::follow(const Shown& frame, const Recognised& seen) noexcept {
  const bool plain = !seen.manner.swapped && !seen.manner.metadata;
  const bool alike = before_ && before_->manner == seen.manner;
  const bool next = before_ && (before_->index + 1) % truth_.frames() == seen.index;
  const bool jumped = next && last_ && frame.frame_id != last_->frame_id + 1;
  const bool unseen = frame.missed > 0;
  settled_ = plain && alike && !jumped && !unseen ? settled_ + 1 : 0;
}

}  // namespace bolo::tools::soak
