#include "src/deblur/mmae_kernels.hpp"

#include <algorithm>
#include <array>
#include <iterator>

#include "src/deblur/kernels.hpp"

#include "src/core/simd_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/deblur/mmae_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <hwy/cache_control.h>
#include <hwy/contrib/math/math-inl.h>

#include "src/deblur/block-inl.hpp"
#include "src/deblur/isa.hpp"
#include "src/motion/targets.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

// Vectors per block of 8 columns, and blocks per vector.
inline constexpr std::size_t kBlockColumns = kStatBlock;
inline constexpr std::size_t kVectorsPerBlock = kLanes < kBlockColumns ? kBlockColumns / kLanes : 1;
inline constexpr std::size_t kBlocksPerVector = kLanes > kBlockColumns ? kLanes / kBlockColumns : 1;
inline constexpr std::size_t kUnit = kVectorsPerBlock * kLanes;  // columns: at least a block, at least a vector

template <typename T>
HWY_INLINE Vec load_values(const T* from, std::size_t count) {
  HWY_ALIGN T padded[kLanes];
  if (HWY_UNLIKELY(count < kLanes)) {
    for (std::size_t i = 0; i < kLanes; ++i) padded[i] = i < count ? from[i] : T(0);
    from = padded;
  }
  if constexpr (sizeof(T) == 2) {
    return widen(from);
  } else {
    return hn::LoadU(Float(), from);
  }
}

inline constexpr float kLargestDifference = 1e7F;  // noises

// Differences in time of one unit of columns, in units of the noise: d[row][difference][lane]. Missing rows are 0.
struct Differences {
  HWY_ALIGN float d[kStatRows][kMostSamples - 1][kUnit];
};

template <typename T>
HWY_INLINE void load_differences(const BlockSamples& in, const ModelTables& tables, std::size_t column,
                                 Vec inverse_noise, Differences& to) {
  const int last = tables.differences() - 1;
  for (int r = 0; r < in.rows; ++r) {
    for (std::size_t v = 0; v < kUnit; v += kLanes) {
      const std::size_t at = column + v;
      const auto columns = static_cast<std::size_t>(in.columns);
      const std::size_t count = at < columns ? std::min(kLanes, columns - at) : 0;
      // Samples lie whole frames apart, where the hardware does not prefetch.
      for (int i = 0; i <= last + 1; ++i) hwy::Prefetch(static_cast<const T*>(in.values[r][i]) + at + kStatColumns);
      Vec before = load_values(static_cast<const T*>(in.values[r][0]) + at, count);
      for (int i = 0; i <= last; ++i) {
        const Vec value = load_values(static_cast<const T*>(in.values[r][i + 1]) + at, count);
        const Vec d = hn::Mul(inverse_noise, hn::Sub(value, before));
        // A NaN carries no information about its block's motion.
        const Vec usable = hn::IfThenElseZero(hn::Lt(hn::Abs(d), all(kLargestDifference)), d);
        hn::Store(usable, Float(), to.d[r][i] + v);
        before = value;
      }
      for (int i = 0, j = last; tables.split <= last && i < j; ++i, --j) {
        const Vec early = hn::Load(Float(), to.d[r][i] + v);
        const Vec late = hn::Load(Float(), to.d[r][j] + v);
        hn::Store(hn::Add(early, late), Float(), to.d[r][i] + v);
        hn::Store(hn::Sub(early, late), Float(), to.d[r][j] + v);
      }
    }
  }
  for (int r = in.rows; r < kStatRows; ++r) std::fill_n(to.d[r][0], std::size(to.d[r]) * kUnit, 0.0F);
}

// Sums eight vectors of per-column sums to eight sums for each block of the unit, side by side.
HWY_INLINE void store_block_sums(const Vec* pair, float (*moments)[kMostPairs], std::size_t p) {
#if HWY_TARGET == HWY_SCALAR
  for (std::size_t q = 0; q < 8; ++q) moments[0][p + q] = hn::GetLane(pair[q]);
#else
  const hn::Repartition<double, Float> two;
  const hn::Full128<float> four;
  constexpr std::size_t kWidth = kLanes < kBlockColumns ? kLanes : kBlockColumns;
  for (std::size_t half = 0; half < 2; ++half) {
    const Vec* q = pair + 4 * half;
    // Of every four lanes: a0 + a2, b0 + b2, a1 + a3, b1 + b3
    const Vec ab = hn::Add(hn::InterleaveLower(Float(), q[0], q[1]), hn::InterleaveUpper(Float(), q[0], q[1]));
    const Vec cd = hn::Add(hn::InterleaveLower(Float(), q[2], q[3]), hn::InterleaveUpper(Float(), q[2], q[3]));
    const auto low = hn::InterleaveLower(two, hn::BitCast(two, ab), hn::BitCast(two, cd));
    const auto high = hn::InterleaveUpper(two, hn::BitCast(two, ab), hn::BitCast(two, cd));
    HWY_ALIGN float sums[kLanes];
    hn::Store(hn::Add(hn::BitCast(Float(), low), hn::BitCast(Float(), high)), Float(), sums);
    for (std::size_t b = 0; b < kBlocksPerVector; ++b) {
      auto sum = hn::Load(four, sums + b * kWidth);
      if constexpr (kWidth > 4) sum = hn::Add(sum, hn::Load(four, sums + b * kWidth + 4));
      hn::StoreU(sum, four, moments[b] + p + 4 * half);
    }
  }
#endif
}

// M = sum over a block's pixels of d d^T, pairs i <= j of each part row by row (ModelTables::split).
template <typename T>
HWY_INLINE void add_moments(const BlockSamples& in, const ModelTables& tables, Vec inverse_noise,
                            float (*moments)[kMostPairs]) {
  constexpr std::size_t kVectors = kUnit / kLanes;
  constexpr std::size_t kParts = kStatRows * kVectors;
  Differences m;
  const auto part = [&](int difference, std::size_t k)
                        HWY_ATTR { return hn::Load(Float(), m.d[k / kVectors][difference] + k % kVectors * kLanes); };
  for (std::size_t column = 0; column < static_cast<std::size_t>(in.columns); column += kUnit) {
    load_differences<T>(in, tables, column, inverse_noise, m);
    float(*block)[kMostPairs] = moments + column / kBlockColumns;
    Vec pair[8];
    std::size_t p = 0;
    for (int i = 0; i < tables.differences(); ++i) {
      Vec left[kParts];
      for (std::size_t k = 0; k < kParts; ++k) left[k] = part(i, k);
      for (int j = i; j < tables.end_of_part(i); ++j, ++p) {
        Vec sum = hn::Zero(Float());
        for (std::size_t k = 0; k < kParts; ++k) sum = hn::MulAdd(left[k], part(j, k), sum);
        pair[p % 8] = sum;
        if (p % 8 == 7) store_block_sums(pair, block, p - 7);
      }
    }
    if (p % 8 == 0) continue;
    for (std::size_t q = p % 8; q < 8; ++q) pair[q] = hn::Zero(Float());
    store_block_sums(pair, block, p - p % 8);
  }
}

inline constexpr std::size_t kModelVectors = kModels / kLanes;
inline constexpr std::size_t kChunk = kModelVectors < 4 ? kModelVectors : 4;  // vectors of models in registers at once
inline constexpr int kTogether = kLanes >= 16 ? 4 : 2;                        // blocks in registers at once

// Scores of kTogether blocks at once: every entry of the table is loaded once for all of them.
HWY_INLINE void add_scores(const ModelTables& tables, const float (*moments)[kMostPairs], float (*score)[kModels]) {
  const int late = tables.differences() - tables.split;
  const int pairs = (tables.split * (tables.split + 1) + late * (late + 1)) / 2;
  for (std::size_t chunk = 0; chunk < kModelVectors; chunk += kChunk) {
    Vec sum[kTogether][kChunk];
    for (int b = 0; b < kTogether; ++b) {
      for (std::size_t c = 0; c < kChunk; ++c) sum[b][c] = hn::Load(Float(), score[b] + (chunk + c) * kLanes);
    }
    for (int p = 0; p < pairs; ++p) {
      const float* table = tables.score[static_cast<std::size_t>(p)].data() + chunk * kLanes;
      Vec entry[kChunk];
      for (std::size_t c = 0; c < kChunk; ++c) entry[c] = hn::Load(Float(), table + c * kLanes);
      for (int b = 0; b < kTogether; ++b) {
        const Vec moment = all(moments[b][p]);
        for (std::size_t c = 0; c < kChunk; ++c) sum[b][c] = hn::MulAdd(moment, entry[c], sum[b][c]);
      }
    }
    for (int b = 0; b < kTogether; ++b) {
      for (std::size_t c = 0; c < kChunk; ++c) hn::Store(sum[b][c], Float(), score[b] + (chunk + c) * kLanes);
    }
  }
}

// exp(score - highest) / sum
HWY_INLINE void normalise(float* score) {
  Vec highest = hn::Load(Float(), score);
  for (std::size_t k = kLanes; k < kModels; k += kLanes) highest = hn::Max(highest, hn::Load(Float(), score + k));
  highest = hn::MaxOfLanes(Float(), highest);
  Vec sum = hn::Zero(Float());
  for (std::size_t k = 0; k < kModels; k += kLanes) {
    const Vec e = hn::Exp(Float(), hn::Max(hn::Sub(hn::Load(Float(), score + k), highest), all(-80.0F)));
    hn::Store(e, Float(), score + k);
    sum = hn::Add(sum, e);
  }
  const Vec share = hn::Div(all(1.0F), hn::SumOfLanes(Float(), sum));
  for (std::size_t k = 0; k < kModels; k += kLanes)
    hn::Store(hn::Mul(share, hn::Load(Float(), score + k)), Float(), score + k);
}

void find_posteriors(const ModelTables& tables, const BlockSamples& in, float inverse_noise, Posteriors& out) noexcept {
  HWY_ALIGN float moments[kStatBlocks][kMostPairs];
  const int blocks = (in.columns + kStatBlock - 1) / kStatBlock;
  if (in.type == PixelType::kUint16) {
    add_moments<std::uint16_t>(in, tables, all(inverse_noise), moments);
  } else {
    add_moments<float>(in, tables, all(inverse_noise), moments);
  }
  for (int b = 0; b < kStatBlocks; ++b) {
    const int columns = std::clamp(in.columns - b * kStatBlock, 0, kStatBlock);
    const auto pixels = static_cast<float>(columns * in.rows);
    for (std::size_t k = 0; k < kModels; ++k) out.of[b][k] = tables.prior[k] + pixels * tables.per_pixel[k];
    if (b >= blocks) std::fill_n(moments[b], kMostPairs, 0.0F);
  }
  for (int b = 0; b < blocks; b += kTogether) {
    add_scores(tables, moments + b, out.of + b);
  }
  for (int b = 0; b < blocks; ++b) normalise(out.of[b]);
}

// Several blocks at once, as registers allow, so that no sum waits for the one before; missing blocks are harmless.
void mix_weights(const ModelTables& tables, int offset, const Posteriors& posteriors, int blocks, BlockWeights& out,
                 int at) noexcept {
  const auto& models = tables.weights[static_cast<std::size_t>(offset)].tap;
  constexpr std::size_t kVectors = (kMostSamples + 1 + kLanes - 1) / kLanes;
  constexpr int kAtOnce = kLanes >= 16 ? 8 : 4;
  static_assert(kStatBlocks % kAtOnce == 0);
  for (int first = 0; first < blocks; first += kAtOnce) {
    Vec sum[kAtOnce][kVectors];
    for (auto& of_block : sum) {
      for (Vec& s : of_block) s = hn::Zero(Float());
    }
    for (std::size_t k = 0; k < kModels; ++k) {
      Vec taps[kVectors];
      for (std::size_t v = 0; v < kVectors; ++v) taps[v] = hn::Load(Float(), models[k].data() + v * kLanes);
      for (int b = 0; b < kAtOnce; ++b) {
        const Vec share = all(posteriors.of[first + b][k]);
        for (std::size_t v = 0; v < kVectors; ++v) sum[b][v] = hn::MulAdd(share, taps[v], sum[b][v]);
      }
    }
    for (int b = 0; b < std::min(kAtOnce, blocks - first); ++b) {
      HWY_ALIGN float taps[kVectors * kLanes];
      for (std::size_t v = 0; v < kVectors; ++v) hn::Store(sum[b][v], Float(), taps + v * kLanes);
      for (int i = 0; i < tables.samples; ++i) out.tap[i][at + first + b] = taps[i];
      out.tap[kMostSamples][at + first + b] = taps[kMostSamples];
    }
  }
}

// All blocks at once, so that no sum waits for the one before it; missing blocks are harmless.
void mix_risks(const RiskTable& table, const Posteriors& posteriors, BlockRisks& risk) noexcept {
  for (std::size_t at = 0; at < kChoices; at += kLanes) {
    Vec sum[kStatBlocks];
    for (Vec& s : sum) s = hn::Zero(Float());
    for (std::size_t k = 0; k < kModels; ++k) {
      const Vec row = hn::Load(Float(), table.of[k] + at);
      for (int b = 0; b < kStatBlocks; ++b) sum[b] = hn::MulAdd(all(posteriors.of[b][k]), row, sum[b]);
    }
    for (int b = 0; b < kStatBlocks; ++b) hn::Store(sum[b], Float(), risk.of[b] + at);
  }
}

HWY_INLINE void store_values(const FilterRow& row, Vec x, std::size_t at, std::size_t count) {
  if (row.output == PixelType::kUint16) {
    if (count == kLanes) return narrow(x, static_cast<std::uint16_t*>(row.out) + at);
    HWY_ALIGN std::uint16_t values[kLanes];
    narrow(x, values);
    std::copy_n(values, count, static_cast<std::uint16_t*>(row.out) + at);
  } else {
    const Vec scaled = hn::MulAdd(all(row.scale), x, all(row.offset));
    if (count == kLanes) return hn::StoreU(scaled, Float(), static_cast<float*>(row.out) + at);
    HWY_ALIGN float values[kLanes];
    hn::Store(scaled, Float(), values);
    std::copy_n(values, count, static_cast<float*>(row.out) + at);
  }
}

// Positions of a vector's pixels between the centres of blocks, for a vector that begins `phase` pixels after a centre.
struct Places {
  HWY_ALIGN std::int32_t cell[kLanes];
  HWY_ALIGN float share[kLanes];

  Places() = default;
  explicit Places(std::size_t phase) {
    for (std::size_t i = 0; i < kLanes; ++i) {
      cell[i] = static_cast<std::int32_t>((phase + i) / kBlockColumns);
      share[i] = (static_cast<float>((phase + i) % kBlockColumns) + 0.5F) / kBlockColumns;
    }
  }
};

// x = newest + sum of w_i (y_i - newest): the weights sum to 1.
template <typename T>
HWY_INLINE void filter_row(int samples, const FilterRow& row, const float (*weights)[kWeightStride]) {
  const auto columns = static_cast<std::size_t>(row.columns);
  const std::size_t phase = static_cast<std::size_t>(row.first_column) + kBlockColumns / 2;
  Places place[kVectorsPerBlock];
  for (std::size_t v = 0; v < kVectorsPerBlock; ++v) place[v] = Places((phase + v * kLanes) % kBlockColumns);
  for (std::size_t at = 0; at < columns; at += kLanes) {
    const std::size_t count = std::min(kLanes, columns - at);
    const std::size_t from_centre = phase + at;
    const Places& places = place[at / kLanes % kVectorsPerBlock];
    const auto block = static_cast<std::size_t>(static_cast<int>(from_centre / kBlockColumns) - 1 - row.first_block);
    const auto cells = hn::SetTableIndices(Float(), places.cell);
    const Vec share = hn::Load(Float(), places.share);
    const Vec newest = load_values(static_cast<const T*>(row.samples[samples - 1]) + at, count);
    Vec x = newest;
    for (int i = 0; i + 1 < samples; ++i) {
      const Vec left = hn::TableLookupLanes(hn::LoadU(Float(), weights[i] + block), cells);
      const Vec right = hn::TableLookupLanes(hn::LoadU(Float(), weights[i] + block + 1), cells);
      const Vec weight = hn::MulAdd(share, hn::Sub(right, left), left);
      hwy::Prefetch(static_cast<const T*>(row.samples[i]) + at + kStatColumns);
      const Vec value = load_values(static_cast<const T*>(row.samples[i]) + at, count);
      x = hn::MulAdd(weight, hn::Sub(value, newest), x);
    }
    store_values(row, x, at, count);
  }
}

void filter(int samples, const FilterRow& row, const BlockWeights& upper, const BlockWeights& lower) noexcept {
  HWY_ALIGN float weights[kMostSamples][kWeightStride];
  const int blocks = row.columns / kStatBlock + 3;
  for (int i = 0; i + 1 < samples; ++i) {
    for (int b = 0; b < blocks; b += static_cast<int>(kLanes)) {
      const Vec above = hn::Load(Float(), upper.tap[i] + b);
      const Vec below = hn::Load(Float(), lower.tap[i] + b);
      hn::Store(hn::MulAdd(all(row.down), hn::Sub(below, above), above), Float(), weights[i] + b);
    }
  }
  if (row.type == PixelType::kUint16) {
    filter_row<std::uint16_t>(samples, row, weights);
  } else {
    filter_row<float>(samples, row, weights);
  }
}

void write(const float* values, const FilterRow& row) noexcept {
  const auto columns = static_cast<std::size_t>(row.columns);
  for (std::size_t at = 0; at < columns; at += kLanes) {
    const std::size_t count = std::min(kLanes, columns - at);
    store_values(row, load_values(values + at, count), at, count);
  }
}

// Binomials with alternating signs.
HWY_INLINE std::array<float, 8> difference_weights(int order) {
  std::array<float, 8> weight{};
  weight[0] = 1.0F;
  for (int i = 1; i <= order; ++i) {
    weight[static_cast<std::size_t>(i)] =
        -weight[static_cast<std::size_t>(i - 1)] * static_cast<float>(order - i + 1) / static_cast<float>(i);
  }
  return weight;
}

template <typename T>
HWY_INLINE void add_squares(const void* const* planes, int order, std::size_t first, int rows, std::size_t stride,
                            std::size_t columns, float* out) {
  const std::array<float, 8> weight = difference_weights(order);
  for (std::size_t at = 0; at < columns; at += kLanes) {
    const std::size_t count = std::min(kLanes, columns - at);
    Vec sum = hn::Zero(Float());
    for (int r = 0; r < rows; ++r) {
      const std::size_t pixel = first + static_cast<std::size_t>(r) * stride + at;
      for (int i = 0; i <= order; ++i) hwy::Prefetch(static_cast<const T*>(planes[i]) + pixel + kStatColumns);
      const Vec base = load_values(static_cast<const T*>(planes[0]) + pixel, count);
      Vec difference = hn::Zero(Float());
      for (int i = 1; i <= order; ++i) {  // relative to the first sample, which drops out: the weights sum to 0
        const Vec value = load_values(static_cast<const T*>(planes[i]) + pixel, count);
        difference = hn::MulAdd(all(weight[static_cast<std::size_t>(i)]), hn::Sub(value, base), difference);
      }
      sum = hn::MulAdd(difference, difference, sum);
    }
    HWY_ALIGN float sums[kLanes];
    hn::Store(sum, Float(), sums);
    for (std::size_t i = 0; i < count; ++i) out[at + i] += sums[i];
  }
}

void add_squared_differences(PixelType type, const void* const* planes, int order, std::size_t first, int rows,
                             std::size_t stride, int columns, float* out) noexcept {
  const auto width = static_cast<std::size_t>(columns);
  if (type == PixelType::kUint16) {
    add_squares<std::uint16_t>(planes, order, first, rows, stride, width, out);
  } else {
    add_squares<float>(planes, order, first, rows, stride, width, out);
  }
}

const MmaeKernels& mmae_kernels() {
  static const MmaeKernels table{HWY_TARGET == HWY_SCALAR ? "scalar" : hwy::TargetName(HWY_TARGET),
                                 find_posteriors,
                                 mix_weights,
                                 mix_risks,
                                 filter,
                                 write,
                                 add_squared_differences};
  return table;
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace bolo::deblur {

HWY_EXPORT(mmae_kernels);

const MmaeKernels& best_mmae_kernels() {
  static const auto found = motion::tables_of_targets(
      HWY_TARGETS, []() -> const MmaeKernels& { return HWY_DYNAMIC_DISPATCH(mmae_kernels)(); });
  return motion::table_for(found, best_isa());
}

}  // namespace bolo::deblur
#endif
