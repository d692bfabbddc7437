// The vector kernels of multiple-model adaptive estimation, built once for every instruction set.
#pragma once

#include <cstddef>
#include <string_view>

#include "src/core/frame.hpp"
#include "src/deblur/motion_models.hpp"

namespace bolo::deblur {

inline constexpr int kStatBlock = 8;                         // pixels a side of a block with one posterior
inline constexpr int kStatRowStep = 2;                       // every other row is used
inline constexpr int kStatRows = kStatBlock / kStatRowStep;  // rows of a block that are used
inline constexpr int kStatBlocks = 8;                        // blocks side by side that are processed together
inline constexpr std::size_t kStatColumns = std::size_t{kStatBlock} * kStatBlocks;  // their pixels
inline constexpr int kCellColumns = 640;                                            // pixels filtered at once
inline constexpr int kWeightStride = kCellColumns / kStatBlock + 2 + 30;  // blocks around them, padded to whole vectors

// The samples of pixels of neighbouring rows: rows[r][i] is the first of `columns` values of sample i in row r.
struct BlockSamples {
  PixelType type = PixelType::kUint16;
  int rows = 0;
  int columns = 0;
  const void* values[kStatRows][kMostSamples] = {};
};

// Posterior probabilities of the models, one row a block.
struct Posteriors {
  alignas(64) float of[kStatBlocks][kModels];
};

// Risks of the choices, by model and by block.
inline constexpr int kChoices = 16;
struct RiskTable {
  alignas(64) float of[kModels][kChoices] = {};
};
struct BlockRisks {
  alignas(64) float of[kStatBlocks][kChoices];
};

// Weights of the samples: [tap][block]; the last row has the mean square errors (ModelTables::Weights).
struct BlockWeights {
  alignas(64) float tap[kMostSamples + 1][kWeightStride];
};

// One row of pixels to filter with weights that are bilinear between the centres of four blocks.
struct FilterRow {
  PixelType type = PixelType::kUint16;
  const void* samples[kMostSamples] = {};  // of the first pixel
  int first_column = 0;                    // of the first pixel in the frame
  int first_block = -1;                    // the block that weights.tap[i][0] belongs to
  int columns = 0;                         // at most kCellColumns
  float down = 0.0F;                       // share of the lower blocks, 0 to 1
  PixelType output = PixelType::kUint16;
  float scale = 1.0F;  // of float output: scale * value + offset
  float offset = 0.0F;
  void* out = nullptr;
};

struct MmaeKernels {
  std::string_view isa;
  // Posteriors of the blocks that `samples` covers (the last may be narrower). Thread: worker.
  void (*posteriors)(const ModelTables& tables, const BlockSamples& samples, float inverse_noise,
                     Posteriors& out) noexcept;
  // weights = sum over models of posterior * weights, for `blocks` blocks from column `at` of `out` on. Thread: worker.
  void (*mix)(const ModelTables& tables, int offset, const Posteriors& posteriors, int blocks, BlockWeights& out,
              int at) noexcept;
  // risk[b] = sum over models of posterior * that model's risks. Thread: worker.
  void (*risks)(const RiskTable& table, const Posteriors& posteriors, BlockRisks& risk) noexcept;
  // Thread: worker.
  void (*filter)(int samples, const FilterRow& row, const BlockWeights& upper, const BlockWeights& lower) noexcept;
  // Writes estimated values as a row's output; uses only `row`'s columns and output fields. Thread: worker.
  void (*write)(const float* values, const FilterRow& row) noexcept;
  // For every column the sum over `rows` rows of the squared difference of the given order in time of `order` + 1
  // planes; rows lie `stride` values apart. Adds to out[columns]. Thread: pipeline.
  void (*add_squared_differences)(PixelType type, const void* const* planes, int order, std::size_t first, int rows,
                                  std::size_t stride, int columns, float* out) noexcept;
};

// The kernels for the instruction set of best_kernels(). Thread: setup.
const MmaeKernels& best_mmae_kernels();

}  // namespace bolo::deblur
