#include "src/motion/estimate.hpp"

#include <algorithm>
#include <cmath>

#include "src/motion/interpolation.hpp"
#include "src/motion/odds.hpp"

namespace bolo::motion {
namespace {

constexpr float kLeastGradient = 0.3F;       // of the noise in the past's mean
constexpr float kLeastUncertainty = 0.005F;  // px a frame
constexpr float kOfSpeed = 0.001F;
constexpr float kOfMisfit = 0.3F;  // of the squared displacement that would explain a misfit: most misfit is not motion
constexpr float kByMotion = 3.0F;  // noise variances of a misfit: any excess along a bent path is due to the bend
constexpr float kSlowest = 0.05F;  // px a frame: least speed that an uncertainty is relative to
constexpr float kSlowPath = 0.3F;  // px a frame: least speed that differences from the path are relative to
constexpr float kSamePath = 0.1F;  // of the speed: up to this difference a block takes the path's weights
constexpr float kOtherPath = 0.3F;     // from here on none of them
constexpr float kFading = 8.0F;        // px a frame below PathWeights::kFastest, over which the path's weights fade out
constexpr float kOfError = 0.3F;       // of the estimate's error, in the trust in the check
constexpr float kOfSmoother = 0.75F;   // of the error per px of smoothness: too optimistic for less smooth scenes
constexpr float kMayLeave = 1.0F;      // px that a trail may reach beyond the border
constexpr float kNearlyRight = 0.05F;  // of a neighbouring block's mean square error
constexpr float kWrongMisfit = 1.5F;   // LocalMotion::misfit() from which an extrapolated frame counts as wrong
constexpr float kAnotherWay = 1.0F;    // px a frame: larger differences are another motion
constexpr float kMeanAge = 0.5F * (kNear + 1);  // of the near past's frames, periods
constexpr std::size_t kFar = kPast - kNear;     // frames
constexpr float kFarPart = float{kFar} / kPast;

// The far past counts for less where it differs from the near past by more than chance: in a block, and in most blocks,
// because a wrong motion is hidden by the noise of each single block.
constexpr float kMisfit = 2.0F;      // price beyond the optimum for differences of noise alone
constexpr float kUnusual = 0.2F;     // excess over chance in the median block that halves the far past's share
constexpr std::size_t kSample = 11;  // every so many blocks are sampled

// Variance of white noise of variance 1 after cubic interpolation at x.
float noise_of_cubic(float x) {
  float w[4];
  cubic(x - std::floor(x), w);
  return w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + w[3] * w[3];
}

float power4(float v) { return v * v * v * v; }

// The block nearest to `block`, of `blocks` along an axis of `pixels`, whose whole trail (by `way`) is in the picture.
int within(int block, int blocks, int pixels, float way) noexcept {
  const float before = -way - static_cast<float>(block * kBlock);
  const float after = static_cast<float>((block + 1) * kBlock - pixels) + way;
  const auto apart = [](float out) { return static_cast<int>(std::ceil(std::max(out - kMayLeave, 0.0F) / kBlock)); };
  return std::clamp(block + (way < 0.0F ? apart(before) : -apart(after)), 0, blocks - 1);
}

}  // namespace

Estimator::Estimator(Geometry geometry, const Inertia& inertia, int ahead)
    : geometry_(geometry),
      inertia_(inertia),
      table_(WeightTable::of(inertia.tau, ahead)),
      path_weights_(inertia, ahead),
      mean_(geometry),
      far_(geometry),
      ahead_(geometry),
      along_(geometry),
      x_(geometry),
      left_(geometry) {
  const int across = blocks_over(geometry.width);
  const int down = blocks_over(geometry.height);
  for (VectorField& f : past_) f = VectorField(across, down);
  for (VectorField* f : {&next_, &tap_step_, &trail_, &direction_}) *f = VectorField(across, down);
  for (ScalarField* f : {&speed_, &lag_, &far_gain_, &far_share_, &bent_, &contrast_across_, &unexplained_, &apart_,
                         &step_, &share_, &most_})
    *f = ScalarField(across, down);
  for (std::size_t i = 0; i < raw_.size(); ++i) raw_[i] = smooth_[i] = ScalarField(across, down);
  leaves_ = BlockField<char>(across, down);
  fit_ = BlockField<FitSums>(across, down);
  weights_ = BlockField<FilterWeights>(across, down);
  across_ = BlockField<AcrossWeights>(across, down);
  place_ = BlockField<WeightTable::Place>(across, down);
}

template <typename T>
std::array<const T*, 3> Estimator::rows_around(const BlockField<T>& field, int row) const noexcept {
  return {field.row(std::max(row - 1, 0)), field.row(row), field.row(std::min(row + 1, field.down() - 1))};
}

void Estimator::extend_row(int row, PaddedPlane& plane) const noexcept {
  const auto [begin, end] = plane.rows_of(row);
  plane.extend(begin, end);
}

// Share of the path's weights in each block of a row, by how closely the block follows the picture's centre.
void Estimator::compare_paths(const EstimateInputs& in, int row) noexcept {
  const Vec2 v = in.path.velocity.at(0.0, 0.0);
  const float speed = std::max(std::hypot(v.x, v.y), kSlowPath);
  const float most = std::clamp((PathWeights::kFastest - speed) / kFading, 0.0F, 1.0F);
  for (int c = 0; c < bent_.across(); ++c) {
    const Centre centre = centre_of(geometry_, 1, c, row);
    float apart = 0.0F;
    for (std::size_t j = 0; j < kNear; ++j) {
      const Affine& span = in.path.spans[j];
      const Vec2 off = span.at(centre.x, centre.y) + in.deviation->at(c, row) - span.at(0.0, 0.0);
      apart = std::max(apart, std::hypot(off.x, off.y));
    }
    bent_.at(c, row) = most * std::clamp((kOtherPath - apart / speed) / (kOtherPath - kSamePath), 0.0F, 1.0F);
  }
}

// Displacements and velocities of a row of blocks. `ways`: displacements of the past's frames along the path.
void Estimator::set_fields(const EstimateInputs& in, std::span<const Affine, kPast> ways, int row) noexcept {
  std::fill_n(bent_.row(row), bent_.across(), 0.0F);
  if (path_weights_.bent()) compare_paths(in, row);
  for (int c = 0; c < trail_.across(); ++c) {
    const Centre centre = centre_of(geometry_, 1, c, row);
    const auto here = [&](const Affine& motion) { return motion.at(centre.x, centre.y); };
    const Vec2 deviation = in.deviation->at(c, row);
    const float bent = bent_.at(c, row);
    for (std::size_t j = 0; j < past_.size(); ++j) {
      Vec2 way = here(in.path.past[j]);
      if (bent > 0.0F) way = way + (here(ways[j]) - way) * bent;
      past_[j].at(c, row) = way + deviation * static_cast<float>(j + 1);
    }
    trail_.at(c, row) = here(in.path.trail) + deviation;
    next_.at(c, row) = here(in.path.ahead) - deviation;
    const Vec2 v = here(in.path.velocity) + deviation;
    const float speed = std::sqrt(v.x * v.x + v.y * v.y);
    speed_.at(c, row) = speed;
    lag_.at(c, row) = WeightTable::lag_of(speed);
    const Vec2 direction = speed < kStill ? Vec2{1.0F, 0.0F} : v * (1.0F / speed);
    direction_.at(c, row) = direction;
    tap_step_.at(c, row) = direction + (path_weights_.step() - direction) * bent;
  }
}

// Collects the available frames among the past's [begin, end).
int Estimator::past_of(const EstimateInputs& in, std::size_t begin, std::size_t end, int row,
                       PastRows& rows) const noexcept {
  int count = 0;
  for (std::size_t j = begin; j < end; ++j) {
    if (in.past[j] == nullptr) continue;
    rows.planes[static_cast<std::size_t>(count)] = in.past[j];
    rows.displacements[static_cast<std::size_t>(count++)] = past_[j].row(row);
  }
  return count;
}

void Estimator::align_past(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept {
  for_rows(crew, weights_.down(), [&](int row) {
    PastRows near;
    const int count = past_of(in, 0, kNear, row, near);
    kernels.align(near.planes.data(), near.displacements.data(), count, *in.now, row, mean_);
    extend_row(row, mean_);
    if (in.ahead == nullptr) return;
    const Vec2* ahead = next_.row(row);
    kernels.align(&in.ahead, &ahead, 1, *in.now, row, ahead_);
    extend_row(row, ahead_);
  });
}

float Estimator::blur(const Kernels& kernels, const EstimateInputs& in) const noexcept {
  const double noise = in.noise * in.noise;
  double of_mean = 0.0;
  for (std::size_t j = 0; j < kNear; ++j) {
    const Vec2 middle = past_[j][fit_.size() / 2];
    of_mean += noise_of_cubic(middle.x) * noise_of_cubic(middle.y) * noise / (kNear * kNear);
  }
  double fine = 0.0;
  double across = 0.0;
  for (const FitSums& fit : fit_) {
    fine += 0.5 * fit.fine;
    across += 0.5 * fit.across;
  }
  const auto blocks = static_cast<double>(fit_.size());
  return path_weights_.blur(kernels, in.path, fine / blocks - of_mean, across / blocks - of_mean, noise);
}

void Estimator::choose_weights(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept {
  for_rows(crew, weights_.down(), [&](int row) {
    kernels.fit(*in.now, mean_, direction_.row(row), lag_.row(row), row, fit_.row(row));
    for (int c = 0; c < fit_.across(); ++c) {
      const FitSums& fit = fit_.at(c, row);
      raw_[0].at(c, row) = fit.error;
      raw_[1].at(c, row) = fit.gradient;
      raw_[2].at(c, row) = fit.structure;
      raw_[3].at(c, row) = fit.across;
    }
  });
  const float blurred = blur(kernels, in);
  const auto noise = static_cast<float>(in.noise * in.noise);
  const auto age = static_cast<float>(inertia_.tau) / kMeanAge;
  const float of_mean = noise / kNear;
  const Vec2 v = in.path.velocity.at(0.0, 0.0);
  path_weights_.correlate(kernels, in.path, blurred, crew);
  const float path_lag = path_weights_.lag_factor() / table_->lag_factor(std::hypot(v.x, v.y), blurred);
  const bool far = std::ranges::find(in.past, nullptr) == in.past.end();
  for_rows(crew, weights_.down(), [&](int row) {
    gauss_of_9(raw_[0], row, smooth_[0]);
    gauss_of_9(raw_[1], row, smooth_[1]);
    mean_of_9(raw_[2], row, smooth_[2]);
    mean_of_9(raw_[3], row, smooth_[3]);
    for (int c = 0; c < weights_.across(); ++c) {
      const float bent = bent_.at(c, row);
      const float lag = 1.0F + bent * (path_lag - 1.0F);
      const float speed = speed_.at(c, row);
      const float structure = lag * std::max(0.5F * smooth_[2].at(c, row) - of_mean, 0.0F);
      const float across = std::max(0.5F * smooth_[3].at(c, row) - of_mean, 0.0F);
      const float by_path =
          bent > 0.0F ? bent * path_weights_.change() * structure * table_->lag_factor(speed, blurred) : 0.0F;
      const float unexplained = std::max(smooth_[0].at(c, row) - kMargin * (noise + of_mean + by_path), 0.0F);
      const float gradient = std::max(smooth_[1].at(c, row) - 0.5F * of_mean, 0.0F) + kLeastGradient * of_mean;
      const float bends = in.bridged == 0 ? bent : 0.0F;  // an extrapolated frame fits badly, too
      const float of_motion = unexplained - bends * std::max(unexplained - kByMotion * noise, 0.0F);
      const float from_fit = of_motion / gradient / (kMeanAge * kMeanAge);
      const float sigma =
          std::sqrt(kOfMisfit * from_fit + kLeastUncertainty * kLeastUncertainty + kOfSpeed * kOfSpeed * speed * speed);
      unexplained_.at(c, row) = unexplained * age * age / noise;
      contrast_across_.at(c, row) = across / noise;
      place_.at(c, row) = table_->place_of(speed, structure / noise, sigma / std::max(speed, kSlowest), blurred);
      far_gain_.at(c, row) = table_->far_gain(place_.at(c, row), unexplained_.at(c, row));
      far_share_.at(c, row) = 0.0F;
    }
  });
  if (far) add_far_past(kernels, in, crew);
  make_path_weights(kernels, in, crew);
  for_rows(crew, weights_.down(), [&](int row) {
    for (int c = 0; c < weights_.across(); ++c) {
      table_->find(kernels, place_.at(c, row), far_share_.at(c, row) / kFarPart, weights_.at(c, row), &path_weights_,
                   bent_.at(c, row));
      table_->find_across(weights_.at(c, row), place_.at(c, row), direction_.at(c, row), contrast_across_.at(c, row),
                          across_.at(c, row));
    }
  });
}

void Estimator::make_path_weights(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept {
  if (!path_weights_.bent()) return;
  std::array<bool, WeightTable::kKinds> wanted{};
  for (std::size_t i = 0; i < place_.size(); ++i) {
    if (bent_[i] == 0.0F) continue;
    for (std::size_t k = 0; k < place_[i].cell.size(); ++k) {
      if (place_[i].share[k] > 0.0F) wanted[place_[i].cell[k] % WeightTable::kKinds] = true;
    }
  }
  path_weights_.make(kernels, in.path, wanted, crew);
}

// The next run of blocks in which, or beside which, the far past is used.
Columns Estimator::next_columns(int row, int begin) const noexcept {
  const auto wants = [&](int c) {
    return std::ranges::any_of(rows_around(far_gain_, row), [&](const float* gain) {
      return std::any_of(gain + std::max(c - 1, 0), gain + std::min(c + 2, far_gain_.across()),
                         [](float g) { return g > 0.0F; });
    });
  };
  Columns found{begin, begin};
  while (found.begin < far_gain_.across() && !wants(found.begin)) ++found.begin;
  found.end = found.begin;
  while (found.end < far_gain_.across() && wants(found.end)) ++found.end;
  return found;
}

// Mean square difference of both means due to noise, in noise variances: mean over some blocks.
float Estimator::noise_of_difference() const noexcept {
  float sum = 0.0F;
  int count = 0;
  for (std::size_t i = 0; i < far_gain_.size(); i += kSample, ++count) {
    for (std::size_t j = 0; j < past_.size(); ++j) {
      const float frames = j < kNear ? kNear : kFar;
      sum += noise_of_cubic(past_[j][i].x) * noise_of_cubic(past_[j][i].y) / (frames * frames);
    }
  }
  return sum / static_cast<float>(count);
}

// Median difference over some of the blocks that use the far past; step_ serves as scratch memory.
float Estimator::usual_difference() noexcept {
  std::size_t count = 0;
  for (std::size_t i = 0; i < far_gain_.size(); i += kSample) {
    if (far_gain_[i] > 0.0F && smooth_[0][i] < kUnseen / 100.0F) step_[count++] = smooth_[0][i];
  }
  if (count == 0) return kUnseen;
  const auto middle = step_.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(step_.begin(), middle, step_.begin() + static_cast<std::ptrdiff_t>(count));
  return *middle;
}

// Adds the far past to the past's mean in blocks of little contrast to noise, where both agree up to noise.
void Estimator::add_far_past(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept {
  for_rows(crew, weights_.down(), [&](int row) {
    std::fill_n(raw_[0].row(row), raw_[0].across(), kUnseen);
    PastRows far;
    const int count = past_of(in, kNear, kPast, row, far);
    for (Columns some = next_columns(row, 0); some.begin < some.end; some = next_columns(row, some.end)) {
      kernels.differ(far.planes.data(), far.displacements.data(), count, mean_, row, some, far_, raw_[0].row(row));
    }
  });
  for_rows(crew, weights_.down(), [&](int row) { gauss_of_9(raw_[0], row, smooth_[0]); });
  const auto noise = static_cast<float>(in.noise * in.noise);
  const float chance = noise * noise_of_difference() + 1e-30F;
  const float usual = usual_difference() / chance;
  const float most = kFarPart / (1.0F + power4(std::max(usual - 1.0F, 0.0F) / kUnusual));
  for_rows(crew, weights_.down(), [&](int row) {
    for (int c = 0; c < far_share_.across(); ++c) {
      const float more = std::max(smooth_[0].at(c, row) / chance - 1.0F, 0.0F);
      far_share_.at(c, row) = most * far_gain_.at(c, row) / (1.0F + more + kMisfit * more * more);
    }
  });
  for_rows(crew, weights_.down(), [&](int row) {
    for (Columns some = next_columns(row, 0); some.begin < some.end; some = next_columns(row, some.end)) {
      kernels.correct(far_, rows_around(far_share_, row).data(), row, some, mean_);
    }
    extend_row(row, mean_);
  });
}

// True if the frame before shows the content of a block's centre; content that has just entered has no past.
bool Estimator::seen_before(int block) const noexcept {
  const Vec2 d = past_[0][static_cast<std::size_t>(block)];
  const int left = block % share_.across() * kBlock;
  const int top = block / share_.across() * kBlock;
  const float x = static_cast<float>(left) + 0.5F * kBlock - d.x;
  const float y = static_cast<float>(top) + 0.5F * kBlock - d.y;
  return x >= 0.0F && y >= 0.0F && x <= static_cast<float>(geometry_.width) &&
         y <= static_cast<float>(geometry_.height);
}

// The innovation shows the scene along one frame's trail, independently of the past. Its residual after the estimate is
// added back where it exceeds noise, and determines the trust in the estimate.
void Estimator::check(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept {
  const auto ratio = static_cast<float>(1.0 / inertia_.tau);
  for_rows(crew, weights_.down(), [&](int row) {
    kernels.check(x_, *in.innovation, *in.now, trail_.row(row), ratio, row, left_, raw_[0].row(row), raw_[1].row(row));
    kernels.distance(x_, in.other, row, apart_.row(row));
  });
  for_rows(crew, weights_.down(), [&](int row) { copy_from_inside(row); });
  for_rows(crew, weights_.down(), [&](int row) { judge(in, row); });
}

// Where trails leave the picture, the nearest block inside tells how well the motion explains the innovation.
void Estimator::copy_from_inside(int row) noexcept {
  for (int c = 0; c < trail_.across(); ++c) {
    const Vec2 way = trail_.at(c, row);
    const int column = within(c, trail_.across(), geometry_.width, way.x);
    const int other = within(row, trail_.down(), geometry_.height, way.y);
    leaves_.at(c, row) = column != c || other != row ? 1 : 0;
    for (std::size_t i = 0; i < 2; ++i) raw_[2 + i].at(c, row) = raw_[i].at(column, other);
  }
}

void Estimator::judge(const EstimateInputs& in, int row) noexcept {
  gauss_of_9(raw_[2], row, smooth_[0]);
  gauss_of_9(raw_[3], row, smooth_[1]);
  const auto noise = static_cast<float>(in.noise * in.noise);
  const auto of_innovation = kMargin * static_cast<float>(inertia_.noise()) * noise;
  const auto first = static_cast<std::size_t>(row) * static_cast<std::size_t>(step_.across());
  for (std::size_t i = first; i < first + static_cast<std::size_t>(step_.across()); ++i) {
    const float expected = in.ahead == nullptr ? WeightTable::error_of(weights_[i], across_[i])
                                               : table_->near_error(place_[i], &path_weights_, bent_[i]);
    const float error = std::max(expected, 0.0F);
    const float left = std::max(smooth_[0][i] - of_innovation, 0.0F);
    step_[i] = leaves_[i] != 0 ? 0.0F : left / (left + of_innovation + kOfError * error * noise + 1e-30F);
    const double smooth = smooth_of(static_cast<double>(speed_[i]), static_cast<double>(place_[i].blurred));
    const auto smoother = static_cast<float>(smooth - kSmooth);
    const float mine = (1.0F + kOfSmoother * smoother) * error + unexplained_[i];
    const Evidence evidence{
        .mine = mine,
        .other = in.other_error[i],
        .per_pixel = table_->per_pixel_error(place_[i]) * error / (mine + 1e-30F),
        .left = smooth_[0][i] / noise,
        .change = smooth_[1][i] / noise,
        .own = raw_[3][i] / noise,
        .speed = std::min(speed_[i], std::hypot(trail_[i].x, trail_[i].y)),  // after a stop the block rests
        .apart = apart_[i] / noise,
        .contrast = contrast_across_[i],
        .seen = seen_before(static_cast<int>(i)),
        .bridged = in.bridged};
    share_[i] = static_cast<float>(in.path.steady) / (1.0F + std::exp(odds(inertia_, in.ahead != nullptr, evidence)));
    if (in.misfit != nullptr) share_[i] *= std::clamp(2.0F * (kWrongMisfit - (*in.misfit)[i]), 0.0F, 1.0F);
    if (!std::isfinite(share_[i]) || !std::isfinite(step_[i])) share_[i] = step_[i] = 0.0F;
  }
}

// Shares are interpolated between blocks. A block whose per-pixel estimate is nearly right takes none from a neighbour
// with another motion, so that none of that motion is blended in.
void Estimator::protect_resting_blocks(const EstimateInputs& in, int row) noexcept {
  for (int c = 0; c < share_.across(); ++c) {
    const auto here = static_cast<std::size_t>(row * share_.across() + c);
    most_[here] = 1.0F;
    for (int v = std::max(row - 1, 0); v <= std::min(row + 1, share_.down() - 1); ++v) {
      for (int u = std::max(c - 1, 0); u <= std::min(c + 1, share_.across() - 1); ++u) {
        const auto beside = static_cast<std::size_t>(v * share_.across() + u);
        const Vec2 apart = trail_[here] - trail_[beside];
        const bool rests = in.other_error[here] < kNearlyRight * in.other_error[beside];
        if (rests && apart.x * apart.x + apart.y * apart.y >= kAnotherWay * kAnotherWay) most_[here] = share_[here];
      }
    }
  }
}

void Estimator::find(const Kernels& kernels, const EstimateInputs& in, Crew& crew, float* out) noexcept {
  path_weights_.follow(in.path);
  std::array<Affine, kPast> ways;
  Affine way;
  for (std::size_t j = 0; j < ways.size(); ++j) {
    ways[j] = way = way + in.path.spans[std::min(j, in.path.spans.size() - 1)];
  }
  for_rows(crew, weights_.down(), [&](int row) { set_fields(in, ways, row); });
  align_past(kernels, in, crew);
  choose_weights(kernels, in, crew);
  const FilterInputs inputs{in.now,
                            &mean_,
                            in.ahead != nullptr ? &ahead_ : nullptr,
                            {in.past[0], in.past[1] != nullptr ? in.past[1] : in.past[0]}};
  for_rows(crew, weights_.down(), [&](int row) {
    kernels.filter(inputs, tap_step_.row(row), rows_around(weights_, row).data(), row, along_);
    extend_row(row, along_);
  });
  for_rows(crew, weights_.down(), [&](int row) {
    kernels.across(along_, direction_.row(row), across_.row(row), row, x_);
    extend_row(row, x_);
  });
  check(kernels, in, crew);
  const bool at_once = in.row_delay.empty();
  const auto blend = [&](const PaddedPlane& sharp, int row) {
    kernels.blend(sharp, in.other, rows_around(share_, row).data(), most_.row(row), row, out);
  };
  for_rows(crew, weights_.down(), [&](int row) {
    protect_resting_blocks(in, row);
    kernels.correct(left_, rows_around(step_, row).data(), row, {0, step_.across()}, x_);
    if (at_once) blend(x_, row);
  });
  if (at_once) return;
  const PaddedPlane& sharp = at_frame_time(kernels, in, crew);
  for_rows(crew, weights_.down(), [&](int row) { blend(sharp, row); });
}

// Moves rows that are sampled later back to the frame's time.
const PaddedPlane& Estimator::at_frame_time(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept {
  for_rows(crew, weights_.down(), [&](int row) {
    extend_row(row, x_);
    const float delay = in.row_delay[static_cast<std::size_t>(row)];
    for (int c = 0; c < trail_.across(); ++c) trail_.at(c, row) = trail_.at(c, row) * -delay;
  });
  for_rows(crew, weights_.down(), [&](int row) { kernels.shift(x_, trail_.row(row), row, left_); });
  return left_;
}

}  // namespace bolo::motion
