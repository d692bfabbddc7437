#include "src/deblur/kernels.hpp"

// Built in: AVX3 (AVX-512), AVX2, SSE4 (on arm64: NEON) and plain scalar code. Sets between them would only lengthen
// the build.
#include "src/core/simd_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/deblur/kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "src/deblur/admm-inl.hpp"
#include "src/deblur/admm_dense-inl.hpp"
#include "src/deblur/dual-inl.hpp"
#include "src/motion/targets.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

void solve_inverse(const InversePlan& plan, const PixelRun& run) noexcept {
  for_each_block(run, [&](std::size_t at, std::size_t count) HWY_ATTR {
    const Pair target = load_pixels(run, plan.target, at, count);
    Pair estimate = target;
    for (int i = 0; i < plan.taps; ++i) {
      const InversePlan::Tap& tap = plan.tap[static_cast<std::size_t>(i)];
      estimate = fma(all(tap.weight), load_pixels(run, tap.slot, at, count) - target, estimate);
    }
    store_pixels(run, estimate, at, count);
  });
}

const Kernels& kernels() {
  static const Kernels table{HWY_TARGET == HWY_SCALAR ? "scalar" : hwy::TargetName(HWY_TARGET), solve_admm, solve_dense,
                             solve_dual, solve_inverse};
  return table;
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace bolo::deblur {
namespace {

HWY_EXPORT(kernels);

const std::vector<const Kernels*>& available() {
  static const auto found =
      motion::tables_of_targets(HWY_TARGETS, []() -> const Kernels& { return HWY_DYNAMIC_DISPATCH(kernels)(); });
  return found;
}

const Kernels* forced = nullptr;

}  // namespace

const Kernels& best_kernels() { return forced != nullptr ? *forced : *available().front(); }

std::vector<std::string_view> available_isas() {
  std::vector<std::string_view> names;
  for (const Kernels* k : available()) names.push_back(k->isa);
  return names;
}

std::string_view best_isa() { return best_kernels().isa; }

bool force_isa(std::string_view isa) {
  if (isa.empty()) forced = nullptr;
  for (const Kernels* k : available()) {
    if (k->isa != isa) continue;
    forced = k;
    return true;
  }
  return isa.empty();
}

}  // namespace bolo::deblur
#endif
