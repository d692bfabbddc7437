// Every instruction set that is built in and that this processor runs, one after the other.
#pragma once

#include <cstdint>

#include <hwy/targets.h>

namespace bolo::deblur {

// Calls use() with dispatch set to each of the sets in `built` (HWY_TARGETS of the caller), best first; afterwards the
// best is chosen again. Lower bits are better. Thread: setup, one at a time.
template <typename Use>
void for_each_target(std::int64_t built, const Use& use) {
  std::int64_t left = (hwy::SupportedTargets() | HWY_STATIC_TARGET) & built;
  for (; left != 0; left &= left - 1) {
    hwy::SetSupportedTargetsForTest(left & -left);
    hwy::GetChosenTarget().DeInit();  // the next dispatch chooses again
    use();
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().DeInit();
}

}  // namespace bolo::deblur
