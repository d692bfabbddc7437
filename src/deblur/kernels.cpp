#include "src/deblur/kernels.hpp"

#include <algorithm>
#include <string>

// Built in: AVX3 (AVX-512), AVX2, SSE4 (on arm64: NEON) and scalar code. Sets between them only lengthen the build.
#include "src/core/simd_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/deblur/kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "src/deblur/dual-inl.hpp"
#include "src/motion/targets.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

// --- ADMM's last iteration from the sweeps' dual (admm_plan.hpp).
//
//   paper / Boyd       here
//   y_i                samples
//   A                  x: input of each bin
//   D                  H x: Haar coefficients, c - Q t of the dual
//   u                  scaled dual of D = z: t / rho
//   w                  D + u, from which z = soft(w) and u = clip(w) follow
//   z - u              w - 2 clip(w): input of the x-update

// An iteration with the constants that all its pixels share, one vector per coefficient.
template <int kBins>
struct Iteration {
  static constexpr std::size_t kLevels = log2_of(kBins);
  HWY_ALIGN float keep[std::size_t{kBins}][kLanes];    // of t_i in w_i
  HWY_ALIGN float weight[std::size_t{kBins}][kLanes];  // of (z - u)_i in the estimate
  HWY_ALIGN float low[kLevels][Dual<kBins>::kPixels];
  HWY_ALIGN float high[kLevels][Dual<kBins>::kPixels];

  Iteration(const AdmmPlan& plan, const Estimate& estimate) {
    for (std::size_t i = 0; i < std::size_t{kBins}; ++i) {
      put(all(plan.keep[i]), keep[i]);
      put(all(estimate.coefficient[i]), weight[i]);
    }
  }

  void set_bounds(const AdmmPlan& plan, std::size_t v, Vec lambda) {
    for (std::size_t level = 0; level < kLevels; ++level) {
      const Vec bound = hn::Mul(all(plan.threshold[level]), lambda);
      put(bound, high[level] + v);
      put(hn::Neg(bound), low[level] + v);
    }
  }

  // Adds coefficient i's part to the estimate; `pull` is the jumps' effect on it.
  template <int kLevel>
  HWY_INLINE Vec add(const Dual<kBins>& m, int i, std::size_t v, Vec pull, Vec estimate) const {
    const Vec w = hn::Add(hn::MulAdd(at(keep[i]), at(m.state[i] + v), at(m.c[i] + v)), pull);
    const Vec u = clip(w, low[kLevel] + v, high[kLevel] + v);
    return hn::MulAdd(at(weight[i]), hn::NegMulAdd(all(2.0F), u, w), estimate);
  }
};

// Adds the wavelets of support kSpan between the jumps `left` and `right`, and all finer ones below them.
template <int kBins, int kSpan>
HWY_INLINE Vec add_tree(const Iteration<kBins>& k, const Dual<kBins>& m, int begin, std::size_t v, Vec left, Vec right,
                        Vec estimate) {
  const Vec ends = hn::Add(left, right);
  const int middle = begin + kSpan / 2;
  constexpr int kLevel = log2_of(kSpan) - 1;
  if constexpr (kSpan == 2) {
    return k.template add<kLevel>(m, middle, v, ends, estimate);
  } else {
    const Vec inner = at(m.state[kBins + middle / 2] + v);
    estimate = k.template add<kLevel>(m, middle, v, hn::NegMulAdd(all(2.0F), inner, ends), estimate);
    estimate = add_tree<kBins, kSpan / 2>(k, m, begin, v, left, inner, estimate);
    return add_tree<kBins, kSpan / 2>(k, m, middle, v, inner, right, estimate);
  }
}

template <int kBins>
void admm_run(const AdmmPlan& plan, const PixelRun& pixels) {
  const Estimate estimate = admm_estimate(plan, pixels.published);
  const DualRun run(plan.start, pixels, estimate);
  Iteration<kBins> iteration(plan, estimate);
  if (pixels.lambda == nullptr) {
    for (std::size_t v = 0; v < Dual<kBins>::kPixels; v += kLanes)
      iteration.set_bounds(plan, v, all(plan.start.lambda));
  }
  for_each_dual<kBins>(run, [&](std::size_t first, Dual<kBins>& m) HWY_ATTR {
    for (std::size_t v = 0; v < m.end; v += kLanes) {
      const std::size_t count = std::min(kLanes, pixels.end - first - v);
      if (pixels.lambda != nullptr) {
        iteration.set_bounds(plan, v, load_lanes<float>(pixels.lambda, first + v, count));
      }
      const Vec left = at(m.jump(0) + v);
      const Vec right = at(m.jump(kBins) + v);
      Vec x = iteration.template add<log2_of(kBins) - 1>(m, 0, v, hn::Sub(left, right), at(m.estimate + v));
      x = add_tree<kBins, kBins>(iteration, m, 0, v, left, right, x);
      store_lanes(pixels, x, first + v, count);
    }
  });
}

void solve_admm(const AdmmPlan& plan, const PixelRun& run) noexcept {
  with_bins(plan.start.bins, [&](auto bins) { admm_run<decltype(bins)::value>(plan, run); });
}

// --- ADMM with full matrices, for bins longer than a frame (admm_plan.hpp). Letters as above; d = z - u.

struct Dense {
  HWY_ALIGN Row b[kMaxDenseBins];  // (S^T M S + rho I)^-1 S^T M Y
  HWY_ALIGN Row w[kMaxDenseBins];  // the over-relaxed point, from which z and u follow
  HWY_ALIGN Row d[kMaxDenseBins];  // z - u
};

HWY_INLINE void add_sample(int bins, const std::array<float, kMaxDenseBins>& weights, Pair value, Row* to) {
  for (int i = 0; i < bins; ++i) {
    store(fma(all(weights[static_cast<std::size_t>(i)]), value, load(to[i])), to[i]);
  }
}

// Computes b and the least-squares start of w, both zero before; returns the samples' mean.
HWY_INLINE Pair begin_dense(const DensePlan& plan, const PixelRun& run, std::size_t at, std::size_t count, Dense& m) {
  Pair sum = pair(0.0F);
  for (int i = 0; i < plan.samples; ++i) {
    sum = sum + load_pixels(run, plan.slot[static_cast<std::size_t>(i)], at, count);
  }
  const Pair mean = all(plan.inverse_count) * sum;
  for (int i = 0; i < plan.samples; ++i) {
    const auto sample = static_cast<std::size_t>(i);
    const Pair value = load_pixels(run, plan.slot[sample], at, count) - mean;
    add_sample(plan.bins, plan.data[sample], value, m.b);
    add_sample(plan.bins, plan.start[sample], value, m.w);
  }
  return mean;
}

// D_i = b_i + sum_k rho (S^T M S + rho I)^-1_ik d_k
HWY_INLINE Pair update_coefficient(const DensePlan& plan, const Dense& m, int i) {
  Pair sum = load(m.b[i]);
  for (int k = 0; k < plan.bins; ++k) {
    sum = fma(all(plan.feedback[static_cast<std::size_t>(k)][static_cast<std::size_t>(i)]), load(m.d[k]), sum);
  }
  return sum;
}

HWY_INLINE void update_z(const DensePlan& plan, Pair limit, Dense& m) {
  for (int i = 0; i < plan.bins; ++i) {
    const Pair w = load(m.w[i]);
    const Pair u = clip(w, limit);
    store(w - u - u, m.d[i]);
  }
}

// w = alpha D + (1 - alpha) z + u = w + alpha (D - z)
HWY_INLINE void update_dual(const DensePlan& plan, Pair limit, Dense& m) {
  for (int i = 0; i < plan.bins; ++i) {
    const Pair w = load(m.w[i]);
    const Pair z = w - clip(w, limit);
    store(fma(all(plan.alpha), update_coefficient(plan, m, i) - z, w), m.w[i]);
  }
}

void solve_dense(const DensePlan& plan, const PixelRun& run) noexcept {
  for_each_block(run, [&](std::size_t at, std::size_t count) HWY_ATTR {
    Dense m;
    for (int i = 0; i < plan.bins; ++i) {
      store(pair(0.0F), m.b[i]);
      store(pair(0.0F), m.w[i]);
    }
    const Pair limit = all(plan.threshold) * load_lambda(run, plan.lambda, at, count);
    Pair estimate = begin_dense(plan, run, at, count, m);
    for (int k = 1; k < plan.iterations; ++k) {
      update_z(plan, limit, m);
      update_dual(plan, limit, m);
    }
    update_z(plan, limit, m);
    const auto& before = plan.basis[static_cast<std::size_t>(run.published.before)];
    const auto& after = plan.basis[static_cast<std::size_t>(run.published.after)];
    for (std::size_t i = 0; i < static_cast<std::size_t>(plan.bins); ++i) {
      const float weight = run.published.weight_before * before[i] + run.published.weight_after * after[i];
      estimate = fma(all(weight), update_coefficient(plan, m, static_cast<int>(i)), estimate);
    }
    store_pixels(run, estimate, at, count);
  });
}

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

// In interior_kernel.cpp, which compiles by itself.
void solve_interior(const InteriorPlan& plan, const PixelRun& run) noexcept;

const Kernels& kernels() {
  static const Kernels table{HWY_TARGET == HWY_SCALAR ? "scalar" : hwy::TargetName(HWY_TARGET),
                             solve_admm,
                             solve_dense,
                             solve_dual,
                             solve_inverse,
                             solve_interior};
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

Status check_isa(std::string_view name) {
  const std::vector<std::string_view> names = available_isas();
  if (name == "auto" || std::find(names.begin(), names.end(), name) != names.end()) return {};
  std::string known = "auto";
  for (const std::string_view each : names) known.append(", ").append(each);
  return bad_input("instruction set \"" + std::string(name) + "\" is not available here; use one of " + known);
}

Status choose_isa(std::string_view name) {
  if (Status good = check_isa(name); !good) return good;
  force_isa(name == "auto" ? "" : name);
  return {};
}

}  // namespace bolo::deblur
#endif
