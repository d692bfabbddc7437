// Nested least-squares fits of camera and stimulus: data, normal equations, unknowns, maps of single pixels, and the
// selection of effects.
//
// A cell is a block of frames times a block of pixels of one recording. Every second cell is held out: excluded from
// fits, and the only data for gaps and gains.
#pragma once

#include "src/diagnose/effect.hpp"

namespace bolo::diagnose {

inline constexpr int kCellFrames = 24;  // at most
// Frames of a cell: 0.12 s, as fewer cells of a slow camera's short capture could not agree on an effect. Thread: any.
Index cell_frames(const Session& session);

// `cell`: number of a block of cell_frames() frames. Pixel: index within the grid.
bool held_out(const Session& session, Index cell, int pixel);

// Squared residuals in units of the floor on held-out cells, by group: one group is a recording's block of frames.
struct Score {
  struct Group {
    double sum = 0.0;
    double count = 0.0;
    std::size_t recording = 0;
  };
  std::vector<Group> groups;
  // Root of the mean, of one recording or of all.
  double gap(std::optional<std::size_t> recording = std::nullopt) const;
};

// Gain of log-likelihood from one score to another and its consistency over groups.
struct Gain {
  double total = 0.0;
  double z = 0.0;
};
Gain gain_of(std::span<const double> parts);  // one of each group
// Of all recordings, or of one.
Gain gain_between(const Score& before, const Score& after, std::optional<std::size_t> recording = std::nullopt);

// Calls work(i) for each recording that has a model, on at most `threads` threads. It must not throw.
void for_each_modelled(const Session& session, int threads, const std::function<void(std::size_t)>& work);

// A session with the noise of one value (K rms) and the evaluated pixels; the session must outlive it.
struct FitData {
  FitData(const Session& session, double floor_k, int threads);

  const Session& session;
  double floor_k;
  int threads;
  std::vector<int> fit_pixels;  // used by fits: a scattered part of
  std::vector<int> all_pixels;  // all that are good and not at the sensor's edge

  bool frame_counts(std::size_t recording, Index frame) const;
  // Residual of a recording in units of the floor, on `pixels`; unused frames and bad pixels are 0.
  Series residual(std::size_t recording, const State& state, std::span<const int> pixels) const;
  Score score(const State& state) const;
  // Calls visit(frame, column, is held out) for each of all_pixels in the frames that count.
  template <typename Visit>
  void for_each_value(std::size_t recording, const Visit& visit) const {
    const Index length = cell_frames(session);
    for (Index k = 0; k < session.recordings[recording].frames(); ++k) {
      if (!frame_counts(recording, k)) continue;
      const Index cell = k / length;
      for (std::size_t j = 0; j < all_pixels.size(); ++j) {
        visit(k, static_cast<Index>(j), held_out(session, cell, all_pixels[j]));
      }
    }
  }
};

// Weighted residual and derivatives of one recording on the fit's pixels.
struct Columns {
  Series residual;
  std::vector<Series> column;             // empty: the parameter has no influence
  std::vector<double> shift;              // moving bars: the residual's share of each frame's shift, px
  std::vector<std::vector<double>> turn;  // the same of each column
};
Columns columns_of(const FitData& data, std::size_t recording, const State& state,
                   const std::vector<Parameter>& parameters);

// Normal equations of one block of frames, training and held-out cells apart: products of all columns, with the
// residual as the last one.
struct Group {
  MatrixXd train;
  MatrixXd test;
};

// One group for each cell_frames(). An empty column is one without influence; `pixels` are those of the columns.
std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels);

// The solution within bounds: unknowns beyond one are clamped to it while that is where the others want them.
VectorXd solve_within(const MatrixXd& normal, const VectorXd& right, const VectorXd& low, const VectorXd& high);

MatrixXd inverse(const MatrixXd& normal);
// Coefficients: one row a column of the basis, one column a column of values.
MatrixXd least_squares(const MatrixXd& basis, const MatrixXd& values);

// Owners of nuisance parameters shared by recordings.
inline constexpr int kAllBars = -1;
inline constexpr int kAllRecordings = -2;

// An error of the stimulus: always fitted, never part of the camera's gap.
struct Nuisance {
  Parameter parameter;
  int recording = kAllBars;
  bool is_level = false;  // shares its prior with all other levels
  double nominal = 0.0;
  double prior =
      0.0;  // standard deviation about `nominal`; 0: free. Of levels: the stated accuracy, see level_spread()
};

std::vector<Nuisance> nuisances(const Session& session, const State& nominal);

inline constexpr double kSoftestEdge_px = 0.35;  // of a target, standard deviation

// The levels' common spread, as a share of the stated accuracy and at most 1, is estimated from all levels together.
inline constexpr double kLevelResolution = 0.005;  // K
double level_spread(const std::vector<Nuisance>& all, const State& state);
// Root mean square of the levels' errors, K.
double level_error(const std::vector<Nuisance>& all, const State& state);

// Log-likelihood (up to a constant) of the levels' errors. Levels of one stated temperature that agree count once: what
// a black body is off by at a set point, it is in every capture.
double level_evidence(const std::vector<Nuisance>& all, const State& state);

// How many levels are off independently of one another: set points where a black body is off alike in all captures.
double independent_levels(const std::vector<Nuisance>& all, const State& state);

// Root mean square of the set points' errors over the accuracy that the bench states; 1 is usual.
double level_excess(const std::vector<Nuisance>& all, const State& state);

// An effect in one of its forms.
struct Choice {
  const Effect* effect = nullptr;
  const Form* form = nullptr;  // null: that of the state
};

// The same effects with the state's forms.
std::vector<Choice> unformed(std::vector<Choice> choices);

struct Unknowns {
  std::vector<Nuisance> nuisances;
  std::vector<Parameter> parameters;  // of nuisances, then of the choices
  std::vector<std::size_t> first;     // of each choice, and one past the last

  Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices);

  // Of one recording: step 0 for those without influence on it. `of`: the parameters, or these and more.
  std::vector<Parameter> touching(const Session& session, std::size_t recording, std::vector<Parameter> of) const;

  // The prior of the stimulus: precision on the diagonal, and its gradient on the right side.
  void add_prior(const State& state, MatrixXd& normal, VectorXd& right) const;
};

// The stimuli as their files describe them, with the frame filter of `state`.
State nominal_of(const Session& session, const State& state);

inline constexpr std::array<MapKind, 4> kMapKinds{MapKind::kOffset, MapKind::kGain, MapKind::kTau, MapKind::kDrift};

// One of each kind, in that order.
template <typename T>
using OfMaps = std::array<T, kMapKinds.size()>;

// Derivatives of the readings by the maps, frames x pixels: 1, T - the gains' reference, dT / d ln tau, the drift.
// Unwanted ones are empty. Thread: any.
OfMaps<Series> bases_of(const Session& session, std::size_t recording, const State& state, const OfMaps<bool>& wanted,
                        std::span<const int> pixels);

// The regression of one pixel's residual on the wanted bases.
struct PixelSums {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  double squares = 0.0;
  double count = 0.0;

  void add(const OfMaps<Series>& bases, Index frame, Index column, double residual);
  // The inverse of `normal`; 0 for unwanted or undetermined bases.
  Eigen::Matrix4d spread(const OfMaps<bool>& wanted) const;
};

// Each pixel's sums over all recordings; `sums_of(recording)` returns those of one.
std::vector<PixelSums> sum_pixels(const Session& session, std::size_t pixels, int threads,
                                  const std::function<std::vector<PixelSums>(std::size_t)>& sums_of);

// Centres the map over `pixels` and shrinks it by its reliability; `noise2` is the mean noise variance.
template <typename Map>
void centre_and_shrink(Map& map, std::span<const int> pixels, double noise2, MapKind kind) {
  constexpr double kSmallMean = 0.15;  // of a map's squares: a mean possible for a few smooth bumps
  const auto count = static_cast<double>(pixels.size());
  double mean = sum_of(pixels, [&](int p) { return map[p] / count; });
  const double square = sum_of(pixels, [&](int p) { return map[p] * map[p] / count; });
  // A few smooth bumps may have a small mean: kept. Offsets' mean belongs to the levels.
  if (kind != MapKind::kOffset && mean * mean < kSmallMean * square) mean = 0.0;
  using Value = typename Map::Scalar;
  for (const int p : pixels) map[p] -= static_cast<Value>(mean);
  const double variance = sum_of(pixels, [&](int p) { return map[p] * map[p] / count; });
  map *= static_cast<Value>(variance > 0.0 ? std::clamp(1.0 - noise2 / variance, 0.0, 1.0) : 0.0);
}

// The state with the maps that `choices` want, re-estimated on the training cells.
State estimate_maps(const FitData& data, State state, const std::vector<Choice>& choices);

// The score with a map of this kind added to a state whose score is `before`.
Score map_gain(const FitData& data, const State& state, const Score& before, MapKind kind);

// Significance, in standard errors, of a parabola in the row means. Columns may differ; pixels of 0 are ignored.
double row_trend_z(const Session& session, const Eigen::VectorXf& map);

// Significance limit of row_trend_z().
inline constexpr double kClearTrend = 4.5;

struct FitResult {
  State state;
  Score score;
  std::vector<Choice> choices;
  std::vector<std::vector<double>> value;  // of each choice's parameters
  std::vector<std::vector<double>> error;
};

// Fits the stimulus, and the parameters and maps of `choices`, from `start` on.
FitResult fit(const FitData& data, const State& start, const std::vector<Choice>& choices, int rounds);

// Repeats the fit, `rounds` at a time, until the gap changes by no more than the share `tolerance`.
FitResult settle(const FitData& data, FitResult from, int rounds, double tolerance);

// Gain of each candidate on held-out cells by the linear model around a fit: a cheap preselection for full fits.
std::vector<Gain> screen(const FitData& data, const FitResult& base, const std::vector<Choice>& candidates);

// Forward selection of effects with nested refits, then backward.
struct Chosen {
  Choice choice;
  FoundEffect found;        // without its parameters
  bool from_map = false;    // found in another's map, which had absorbed it
  Score before{}, after{};  // its addition
};

struct Selection {
  FitResult fit;
  std::vector<Chosen> chosen;  // in order of selection; gaps are nested
};

// Minimum gain of an effect on held-out cells, in log-likelihood, and of its consistency over groups.
inline constexpr double kLeastGain = 20.0;
inline constexpr double kLeastZ = 2.2;

// `allowed`: the effects that may be selected. `progress` gets the effect being tried.
Selection select_effects(const FitData& data, const FitResult& base, const std::function<bool(const Effect&)>& allowed,
                         const Progress& progress);

}  // namespace bolo::diagnose
