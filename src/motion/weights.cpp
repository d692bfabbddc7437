#include "src/motion/weights.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <thread>

#include <Eigen/Dense>
#include <Eigen/SparseCore>

#include "src/core/threads.hpp"
#include "src/motion/best_weights.hpp"
#include "src/motion/path_weights.hpp"
#include "src/motion/scene_covariances.hpp"

namespace bolo::motion {
namespace {

constexpr double kFixedPattern = 0.5;       // in units of the noise
constexpr double kSmallestContrast = 1e-4;  // noise variances; a decade a step
constexpr unsigned kMostThreads = 4;
constexpr std::array kUncertain = {0.004, 0.02, 0.07, 0.25, 1.0};  // of the speed
constexpr double kSmallestRatio = 1e-3;                            // of contrast across to noise
constexpr double kRatioDecades = 0.15;                             // a step
constexpr float kLeastLess = 0.01F;     // of the mean square error: least gain for which the far past is used
constexpr float kWorthwhile = 0.1F;     // further gain at which it is used in full
constexpr float kLeastAcross = 0.007F;  // noise variances
constexpr float kSlanted = 0.4F;        // of the noise, that interpolation removes on the diagonal
constexpr float kLargestIndex = 1e-4F;  // below the last, so that there is one above

// Of 0.6, 1.0 and 1.5 px, 1.0 left the least error below half a pixel a frame, 0.6 from one on (street stills, 0 and
// 0.5 px blur).
constexpr double kSmoother = 1.0;
constexpr double kSlow = 0.6;  // px a frame: up to here kSmoother
constexpr double kFast = 1.2;  // from here on kSmooth

// Weighted sums of raw values that share one weight.
struct Taps {
  std::vector<Raw> raw;
  std::array<Eigen::SparseMatrix<double>, 2> rows;  // with the near past's mean, and the whole past's
};

// Taps in the order of FilterWeights.
Taps taps_at(double speed, int ahead) {
  std::vector<std::vector<Raw>> rows;
  for (int j = -kReach; j <= kReach; ++j) rows.push_back({{0, static_cast<double>(j)}});
  for (int j = -kReach; j <= kReach; ++j) {
    rows.emplace_back();
    for (int k = 1; k <= kPast; ++k) rows.back().push_back({k, j - speed * k});
  }
  for (int k = 1; k <= 2; ++k) rows.push_back({{k, 0.0}});
  for (int j = -kReach; ahead > 0 && j <= kReach; ++j) rows.push_back({{-1, j + speed}});
  Taps taps;
  for (const auto& row : rows) taps.raw.insert(taps.raw.end(), row.begin(), row.end());
  for (auto& m : taps.rows) {
    m.resize(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(taps.raw.size()));
  }
  Eigen::Index column = 0;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const bool near = rows[r].size() == 1;
    for (const Raw& raw : rows[r]) {
      const auto row = static_cast<Eigen::Index>(r);
      if (near || raw.back <= kNear) taps.rows[0].insert(row, column) = near ? 1.0 : 1.0 / kNear;
      taps.rows[1].insert(row, column++) = 1.0 / static_cast<double>(rows[r].size());
    }
  }
  return taps;
}

// Input of best_weights().
struct Moments {
  Eigen::MatrixXd scene;
  Eigen::MatrixXd noise;
  Eigen::VectorXd truth;
  Eigen::VectorXd sums;

  Moments(std::span<const Raw> values, SceneCovariances& covariances) {
    const auto n = static_cast<Eigen::Index>(values.size());
    scene.resize(n, n);
    noise.resize(n, n);
    truth.resize(n);
    sums.setOnes(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Raw& a = values[static_cast<std::size_t>(i)];
      truth(i) = covariances.with_truth(a);
      for (Eigen::Index j = 0; j <= i; ++j) {
        const Raw& b = values[static_cast<std::size_t>(j)];
        scene(i, j) = scene(j, i) = covariances.of(a, b);
        noise(i, j) = noise(j, i) = shared_noise(a.back == b.back, std::abs(a.at - b.at));
      }
    }
  }
  Moments(const Eigen::SparseMatrix<double>& rows, const Moments& of)
      : scene(rows * of.scene * rows.transpose()),
        noise(rows * of.noise * rows.transpose()),
        truth(rows * of.truth),
        sums(rows * of.sums) {}
  void weigh(Eigen::Index m, double variance, FilterWeights& out) const {
    const Eigen::MatrixXd some = scene.topLeftCorner(m, m);
    const Eigen::MatrixXd some_noise = noise.topLeftCorner(m, m);
    const Eigen::VectorXd some_truth = truth.head(m);
    const Eigen::VectorXd some_sums = sums.head(m);
    best_weights(some, some_noise, some_truth, some_sums, variance, out);
  }
};

float index_in(const float* grid, int size, float value) {
  int i = 0;
  while (i + 2 < size && value >= grid[i + 1]) ++i;
  const float share = (value - grid[i]) / (grid[i + 1] - grid[i]);
  return static_cast<float>(i) + std::clamp(share, 0.0F, 1.0F - kLargestIndex);
}

}  // namespace

double smooth_of(double speed, double blurred) noexcept {
  const double sharp = kSmooth + (kSmoother - kSmooth) * std::clamp((kFast - speed) / (kFast - kSlow), 0.0, 1.0);
  return sharp + blurred * (kBlurred - sharp);
}

double shared_noise(bool same_frame, double apart) noexcept {
  return std::max(1.0 - apart, 0.0) * ((same_frame ? 1.0 : 0.0) + kFixedPattern * kFixedPattern);
}

double WeightTable::contrast_of(std::size_t kind) noexcept {
  const std::size_t decade = kind / kUncertainties;
  return kSmallestContrast * std::pow(10.0, static_cast<double>(decade));
}

double WeightTable::uncertainty_of(std::size_t kind) noexcept { return kUncertain[kind % kUncertainties]; }

WeightTable::WeightTable(double tau_periods, int ahead) : tau_(tau_periods), ahead_(ahead) {
  constexpr std::array kFirstSpeeds = {0.02, 0.05, 0.1};
  for (std::size_t i = 0; i < kSpeeds; ++i) {
    const double decades = -0.8 + 2.4 * (static_cast<double>(i) - 3.0) / 18.0;
    speed_[i] = i < kFirstSpeeds.size() ? kFirstSpeeds[i] : std::pow(10.0, decades);
    log_speed_[i] = static_cast<float>(std::log(speed_[i]));
  }
  for (const std::size_t blurred : {0U, 1U}) begin(scenes_[blurred], static_cast<double>(blurred));
}

void WeightTable::begin(Scene& scene, double blurred) const {
  for (std::size_t i = 0; i < kSpeeds; ++i) {
    const double smooth = scene.smooth[i] = smooth_of(speed_[i], blurred);
    const auto along = [&](double lag) { return structure_of(tau_, 0.0, speed_[i], lag, smooth); };
    scene.lag_factor[i] = static_cast<float>(along(2.0) / along(lag_of(static_cast<float>(speed_[i]))));
    const double across = structure_of(tau_, speed_[i], 0.0, 2.0, smooth);
    scene.across_factor[i] = static_cast<float>((1.0 - covariance_of(2.0, smooth)) / across);
  }
  fill_across(scene);
}

std::shared_ptr<const WeightTable> WeightTable::of(double tau_periods, int ahead) {
  static std::mutex alone;
  static std::map<double, std::vector<std::shared_ptr<const WeightTable>>> made;
  const std::lock_guard lock(alone);
  std::vector<std::shared_ptr<const WeightTable>>& tables = made[tau_periods];
  if (static_cast<int>(tables.size()) <= ahead) {
    std::vector<std::shared_ptr<WeightTable>> all;
    for (int a = 0; a <= ahead; ++a) all.emplace_back(new WeightTable(tau_periods, a));
    fill(all);
    tables.insert(tables.end(), all.begin() + static_cast<std::ptrdiff_t>(tables.size()), all.end());
  }
  return tables[static_cast<std::size_t>(ahead)];
}

void WeightTable::fill(std::span<const std::shared_ptr<WeightTable>> tables) {
  constexpr std::size_t kScenes = std::tuple_size_v<decltype(scenes_)>;
  share_out(kScenes * kSpeeds * kUncertainties, std::min(std::thread::hardware_concurrency(), kMostThreads),
            [&](std::size_t i) {
              fill(tables, i % kScenes, kSpeeds - 1 - i / kScenes / kUncertainties,
                   i / kScenes % kUncertainties);  // the fast ones take longest
            });
}

// Linear minimum-mean-square weights of unit sum for the scene's autocovariance in white noise.
void WeightTable::fill_across(Scene& scene) noexcept {
  constexpr int kSide = AcrossWeights::kReach;
  constexpr int kSize = 2 * kSide + 1;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;
  using Vector = Eigen::Matrix<double, kSize, 1>;
  const double smooth = scene.smooth.back();
  for (int i = 0; i < kRatios; ++i) {
    const double variance = kSmallestRatio * std::pow(10.0, kRatioDecades * i) / (1.0 - covariance_of(2.0, smooth));
    Matrix values;
    for (int a = 0; a < kSize; ++a) {
      for (int b = 0; b < kSize; ++b) values(a, b) = variance * covariance_of(a - b, smooth);
    }
    const Eigen::LDLT<Matrix> factors(values + Matrix::Identity());
    const Vector a = factors.solve(values.col(kSide));
    const Vector b = factors.solve(Vector::Ones());
    const Vector w = a + (1.0 - a.sum()) / b.sum() * b;
    AcrossWeights& out = scene.across[static_cast<std::size_t>(i)];
    for (int k = 0; k < kSide; ++k) out.w[k] = static_cast<float>(w(kSide + 1 + k));
    out.error = static_cast<float>(variance - 2.0 * w.dot(values.col(kSide)) + w.dot(values * w) + w.squaredNorm());
  }
}

// Covariances take nearly all of the time: those without look-ahead are a subset of those with it.
void WeightTable::fill(std::span<const std::shared_ptr<WeightTable>> tables, std::size_t which, std::size_t speed,
                       std::size_t uncertainty) {
  const WeightTable& most = *tables.back();
  const double v = most.speed_[speed];
  const double smooth = most.scenes_[which].smooth[speed];
  SceneCovariances covariances(most.tau_, v, kUncertain[uncertainty] * v, smooth);
  const double unit = structure_of(most.tau_, 0.0, v, 2.0, smooth);
  const Taps taps = taps_at(v, most.ahead_);
  const Moments raw(taps.raw, covariances);
  const std::array<Moments, 2> of{Moments(taps.rows[0], raw), Moments(taps.rows[1], raw)};
  for (const std::shared_ptr<WeightTable>& table : tables) {
    std::vector<Raw> own;
    for (int back = -table->ahead_; back <= 2; ++back) own.push_back({back, 0.0});
    const Moments of_own(own, covariances);
    const Eigen::Index m = FilterWeights::kAhead + table->ahead_ * kTaps;
    Scene& scene = table->scenes_[which];
    for (std::size_t c = 0; c < kContrasts; ++c) {
      const double variance = contrast_of(c * kUncertainties) / unit;
      const std::size_t i = cell(speed, c, uncertainty);
      for (std::size_t far = 0; far < of.size(); ++far) of[far].weigh(m, variance, scene.cells[far][i]);
      scene.near_error[i] = scene.cells[0][i].w[FilterWeights::kError];
      scene.far_less[i] = 1.0F - scene.cells[1][i].w[FilterWeights::kError] / scene.near_error[i];
      FilterWeights by_own;
      of_own.weigh(static_cast<Eigen::Index>(own.size()), variance, by_own);
      scene.per_pixel[i] = by_own.w[FilterWeights::kError] - by_own.w[FilterWeights::kNoise];
    }
  }
}

template <typename Of>
float WeightTable::of_scenes(float blurred, const Of& of) const noexcept {
  if (blurred == 0.0F) return of(scenes_[0]);
  return (1.0F - blurred) * of(scenes_[0]) + blurred * of(scenes_[1]);
}

template <typename Of>
float WeightTable::of_cells(const Place& place, const Of& of) const noexcept {
  return of_scenes(place.blurred, [&](const Scene& scene) {
    float sum = 0.0F;
    for (std::size_t k = 0; k < place.cell.size(); ++k) sum += place.share[k] * of(scene, place.cell[k]);
    return sum;
  });
}

float WeightTable::per_pixel_error(const Place& place) const noexcept {
  return of_cells(place, [](const Scene& scene, std::size_t cell) { return scene.per_pixel[cell]; });
}

float WeightTable::lag_of(float speed) noexcept { return std::clamp(2.0F + 0.8F * (speed - 1.0F), 2.0F, 24.0F); }

float WeightTable::between(const std::array<float, kSpeeds>& values, float at) noexcept {
  const auto before = static_cast<std::size_t>(at);
  return values[before] + (at - static_cast<float>(before)) * (values[before + 1] - values[before]);
}

float WeightTable::index_of(float speed) const noexcept {
  return index_in(log_speed_.data(), kSpeeds, std::log(std::max(speed, 1e-6F)));
}

float WeightTable::lag_factor(float speed, float blurred) const noexcept {
  return lag_factor_at(index_of(speed), blurred);
}

float WeightTable::lag_factor_at(float index, float blurred) const noexcept {
  return of_scenes(blurred, [index](const Scene& scene) { return between(scene.lag_factor, index); });
}

void WeightTable::find_across(const FilterWeights& along, const Place& place, Vec2 e, float structure,
                              AcrossWeights& out) const noexcept {
  const float factor =
      of_scenes(place.blurred, [&](const Scene& scene) { return between(scene.across_factor, place.speed); });
  const float noise = along.w[FilterWeights::kNoise] * (1.0F - kSlanted * 2.0F * std::abs(e.x * e.y));
  const float ratio = std::max(structure, kLeastAcross) * factor / std::max(noise, 1e-9F);
  const float decades = std::log10(ratio / static_cast<float>(kSmallestRatio));
  const float b = std::clamp(decades / static_cast<float>(kRatioDecades), 0.0F, kRatios - 1.0F - kLargestIndex);
  const auto ib = static_cast<std::size_t>(b);
  const float fb = b - static_cast<float>(ib);
  const auto mixed = [&](const auto& value) {
    return of_scenes(place.blurred, [&](const Scene& scene) {
      return value(scene.across[ib]) + fb * (value(scene.across[ib + 1]) - value(scene.across[ib]));
    });
  };
  for (int i = 0; i < AcrossWeights::kReach; ++i) out.w[i] = mixed([i](const AcrossWeights& w) { return w.w[i]; });
  out.error = mixed([](const AcrossWeights& w) { return w.error; });
}

WeightTable::Place WeightTable::place_of(float speed, float structure, float uncertainty,
                                         float blurred) const noexcept {
  static const std::array<float, kUncertainties> kLogUncertain = [] {
    std::array<float, kUncertainties> logs{};
    for (std::size_t i = 0; i < kUncertainties; ++i) logs[i] = static_cast<float>(std::log(kUncertain[i]));
    return logs;
  }();
  const float a = index_of(speed);
  const auto at = static_cast<std::size_t>(a);
  const float fa = a - static_cast<float>(at);
  const float contrast = structure * lag_factor_at(a, blurred);
  const float decades = std::log10(std::max(contrast, 1e-6F)) - static_cast<float>(std::log10(kSmallestContrast));
  const float b = std::clamp(decades, 0.0F, kContrasts - 1.0F - kLargestIndex);
  const int ib = static_cast<int>(b);
  const float fb = b - static_cast<float>(ib);
  const float c = index_in(kLogUncertain.data(), kUncertainties, std::log(std::max(uncertainty, 1e-6F)));
  const int ic = static_cast<int>(c);
  const float fc = c - static_cast<float>(ic);
  Place place;
  place.speed = a;
  place.blurred = blurred;
  for (std::size_t k = 0; k < place.cell.size(); ++k) {
    const std::size_t da = k & 1U;
    const std::size_t db = (k >> 1U) & 1U;
    const std::size_t dc = k >> 2U;
    place.share[k] = (da != 0 ? fa : 1.0F - fa) * (db != 0 ? fb : 1.0F - fb) * (dc != 0 ? fc : 1.0F - fc);
    place.cell[k] =
        static_cast<std::uint16_t>(cell(at + da, static_cast<std::size_t>(ib) + db, static_cast<std::size_t>(ic) + dc));
  }
  return place;
}

float WeightTable::near_error(const Place& place, const PathWeights* path, float bent) const noexcept {
  return of_cells(place, [&](const Scene& scene, std::size_t cell) {
    const float straight = scene.near_error[cell];
    const FilterWeights* of_path = path != nullptr && bent > 0.0F ? path->at(cell % kKinds) : nullptr;
    const float along = of_path != nullptr ? of_path->w[FilterWeights::kError] : straight;
    return straight + bent * (along - straight);
  });
}

float WeightTable::far_gain(const Place& place, float beside) const noexcept {
  const float less = of_cells(place, [](const Scene& scene, std::size_t cell) { return scene.far_less[cell]; });
  const float error = std::max(near_error(place), 0.0F);
  return std::clamp((less * error / (error + beside + 1e-30F) - kLeastLess) / kWorthwhile, 0.0F, 1.0F);
}

void WeightTable::find(const Kernels& kernels, const Place& place, float far, FilterWeights& out,
                       const PathWeights* path, float bent) const noexcept {
  std::array<const FilterWeights*, 40> corners;
  std::array<float, 40> shares;
  std::size_t count = 0;
  const auto add = [&](const FilterWeights& w, float share) {
    if (share == 0.0F) return;
    corners[count] = &w;
    shares[count++] = share;
  };
  for (std::size_t k = 0; k < place.cell.size(); ++k) {
    const FilterWeights* of_path = path != nullptr && bent > 0.0F ? path->at(place.cell[k] % kKinds) : nullptr;
    const float along = of_path != nullptr ? bent : 0.0F;
    if (of_path != nullptr) add(*of_path, (1.0F - far) * along * place.share[k]);
    for (std::size_t i = 0; i < scenes_.size(); ++i) {
      const float share = (i == 0 ? 1.0F - place.blurred : place.blurred) * place.share[k];
      add(scenes_[i].cells[0][place.cell[k]], (1.0F - far) * (1.0F - along) * share);
      add(scenes_[i].cells[1][place.cell[k]], far * share);
    }
  }
  kernels.mix(corners.data(), shares.data(), count, out);
}

}  // namespace bolo::motion
