// The pixel loops, built once for every instruction set (Highway) and chosen at run time; kernels of a row of blocks
// may run at the same time for different rows. Displacements d follow the scene: the content at p - d is now at p.
#pragma once

#include <cstddef>
#include <string_view>

#include "src/motion/block_field.hpp"
#include "src/motion/padded_plane.hpp"

namespace bolo::motion {

// Sums over a block's pixels with source inside the frame: a = earlier plane moved by d, gradient g, residual e = b -
// a.
struct MatchSums {
  float xx = 0.0F;  // g_x g_x
  float xy = 0.0F;
  float yy = 0.0F;
  float xe = 0.0F;  // g_x e
  float ye = 0.0F;
  float ee = 0.0F;
  float count = 0.0F;
};

// Weights of the estimate of one block: of the newest frame along the motion, of the past's mean along the motion, of
// the pixel itself one and two frames before, of the frame after along the motion; then the expected mean square error
// and noise's share of it, in units of the noise's variance.
inline constexpr int kReach = 5;
inline constexpr int kTaps = 2 * kReach + 1;
inline constexpr int kPast = 8;  // frames that are moved onto the newest
inline constexpr int kNear = 3;  // of these, in the near past's mean; the others are the far past
struct alignas(64) FilterWeights {
  static constexpr int kMean = kTaps;
  static constexpr int kBefore = 2 * kTaps;
  static constexpr int kAhead = 2 * kTaps + 2;
  static constexpr int kError = 3 * kTaps + 2;
  static constexpr int kNoise = kError + 1;
  static constexpr std::ptrdiff_t kStride = 40;
  float w[kStride] = {};
};

// Weights of a pixel's differences to its neighbours up to 3 px away, along the axis more perpendicular to the motion.
struct AcrossWeights {
  static constexpr int kReach = 3;
  float w[kReach] = {};
  float error = 1.0F;  // expected mean square error after the filter, of white noise of variance 1 before it
};

struct FitSums {
  float error = 0.0F;      // (y - M)^2
  float gradient = 0.0F;   // of M along the motion, squared
  float structure = 0.0F;  // (M(p + lag e) - M(p))^2
  float across = 0.0F;     // the same 2 px along the axis more perpendicular to the motion
  float fine = 0.0F;       // 1 px along it
};

inline constexpr float kUnseen = 1e30F;

struct Columns {
  int begin = 0;
  int end = 0;
};

struct FilterInputs {
  const PaddedPlane* now = nullptr;
  const PaddedPlane* mean = nullptr;
  const PaddedPlane* ahead = nullptr;  // null without look-ahead
  const PaddedPlane* before[2] = {};
};

// Parts of a trail: the scene's position when a value saw it, relative to now; `doubt`: its age times sqrt(2) standard
// deviations of the velocity, px; `blur`: variance of its own length, px^2; `share`: its part in the value.
struct SceneTrail {
  static constexpr int kMost = 128;
  int count = 0;
  alignas(64) float x[kMost] = {};
  alignas(64) float y[kMost] = {};
  alignas(64) float doubt[kMost] = {};
  alignas(64) float blur[kMost] = {};
  alignas(64) float share[kMost] = {};
};

struct Kernels {
  std::string_view isa;
  // out = gain now - (gain - 1) before, whole rows [begin, end).
  void (*innovate)(const PaddedPlane& now, const PaddedPlane& before, float gain, int begin, int end,
                   PaddedPlane& out) noexcept;
  // A Gaussian of 1 px, rows [begin, end) of `out`; `from` is extended.
  void (*smooth)(const PaddedPlane& from, int begin, int end, PaddedPlane& out) noexcept;
  // Means of 2 x 2, rows [begin, end) of `out`.
  void (*halve)(const PaddedPlane& from, int begin, int end, PaddedPlane& out) noexcept;
  // The first pixel of a row in [x, end) that is an extremum by more than `least` both along its row and along its
  // column; `end` if there is none. Reads a vector beyond `end`.
  int (*next_extreme)(const float* row, std::ptrdiff_t stride, int x, int end, float least) noexcept;
  // Mean |b(p) - a(p - d)| over the pixels in both, for a whole d; a large number where these are too few.
  float (*mean_difference)(const PaddedPlane& a, const PaddedPlane& b, int dx, int dy) noexcept;
  // A row of blocks; `margin`: pixels inside the frame's border that a source must keep.
  void (*match)(const PaddedPlane& a, const PaddedPlane& b, const Vec2* d, int block_row, float margin,
                MatchSums* out) noexcept;
  // Bias per pixel of the sums (xe, ye) by the noise of the frame between two innovations, for `count` displacements;
  // `shared`: variance of that noise in both innovations (innovation.hpp).
  void (*pull)(const Vec2* d, int count, float shared, Vec2* out) noexcept;
  // Mean over the block of min(e^2, cap).
  void (*cost)(const PaddedPlane& a, const PaddedPlane& b, const Vec2* d, int block_row, float cap,
               float* out) noexcept;
  // The whole displacement (up to 9 across, 5 down) beyond `d` for which 12 x 12 pixels of half-size planes around a
  // block's centre match best; `price` a squared pixel of displacement, as a mean square difference. Returns it less d.
  Vec2 (*search)(const PaddedPlane& a, const PaddedPlane& b, int column, int row, Vec2 d, float price) noexcept;
  // Means of b, and of its squared deviations from them, over blocks.
  void (*energy)(const PaddedPlane& b, int block_row, float* mean, float* square) noexcept;
  // Mean of the planes moved by their displacements (bicubic) that cover a pixel; `now` where none does.
  void (*align)(const PaddedPlane* const* planes, const Vec2* const* d, int count, const PaddedPlane& now,
                int block_row, PaddedPlane& out) noexcept;
  // One bicubic shift of a row of blocks: out(p) = from(p - d).
  void (*shift)(const PaddedPlane& from, const Vec2* d, int block_row, PaddedPlane& out) noexcept;
  // out = mean of the planes moved by their displacements (bicubic), less `from`; block means of its square. Blocks
  // that not all planes cover wholly: 0 and kUnseen.
  void (*differ)(const PaddedPlane* const* planes, const Vec2* const* d, int count, const PaddedPlane& from,
                 int block_row, Columns columns, PaddedPlane& out, float* square) noexcept;
  void (*fit)(const PaddedPlane& now, const PaddedPlane& mean, const Vec2* direction, const float* lag, int block_row,
              FitSums* out) noexcept;
  // Sum of the corners times their shares.
  void (*mix)(const FilterWeights* const* corners, const float* shares, std::size_t count, FilterWeights& out) noexcept;
  // x = sum of weights times values `step` apart; `weights`: rows of blocks above, at and below `block_row`.
  void (*filter)(const FilterInputs& in, const Vec2* step, const FilterWeights* const* weights, int block_row,
                 PaddedPlane& out) noexcept;
  // Smoothed across the motion, each block with its weights; `from` is extended.
  void (*across)(const PaddedPlane& from, const Vec2* direction, const AcrossWeights* weights, int block_row,
                 PaddedPlane& out) noexcept;
  // left = z - (x averaged along one frame's trail d, share(f) ~ exp(-f ratio)); block sums of left^2 and (z - y)^2.
  void (*check)(const PaddedPlane& x, const PaddedPlane& z, const PaddedPlane& y, const Vec2* d, float ratio,
                int block_row, PaddedPlane& left, float* left_square, float* change_square) noexcept;
  // Block means of (x - other)^2; `other` is a plane of the frame's size.
  void (*distance)(const PaddedPlane& x, const float* other, int block_row, float* square) noexcept;
  // x += w left, w interpolated between blocks; rows of w as in filter.
  void (*correct)(const PaddedPlane& left, const float* const* w, int block_row, Columns columns,
                  PaddedPlane& x) noexcept;
  // out = c x + (1 - c) other, whole rows of the frame; c is interpolated between blocks, as w in correct, and within a
  // block limited to its `most`. `other` and `out` are planes of the frame's width.
  void (*blend)(const PaddedPlane& x, const float* other, const float* const* c, const float* most, int block_row,
                float* out) noexcept;
  // For j = first, first + 1 ...: the sum over both trails of shares times c(r), r^2 the square of a - b + j step plus
  // that of the difference of their doubts plus their blurs. As a mean over velocities accurate to 2 %, and like it a
  // covariance: c falls completely monotonically with r^2. `smooth`: as in covariance. Thread: any.
  void (*correlate)(const SceneTrail& a, const SceneTrail& b, Vec2 step, int first, int count, float smooth,
                    double* out) noexcept;
  // Sum over i of share[i] c(r_i), r_i the length of (x + i dx, y + i dy), to 2e-7; c is the scene's autocovariance
  // (weights.hpp), smooth over so many px. Thread: setup.
  double (*covariance)(const float* share, std::size_t count, double x, double dx, double y, double dy,
                       float smooth) noexcept;
};

// The best this processor has, or the one forced: "" is the best. Thread: setup.
const Kernels& best_kernels(std::string_view isa = {});

}  // namespace bolo::motion
