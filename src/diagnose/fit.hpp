// Nested least-squares fits of camera and stimulus: data, normal equations, unknowns, per-pixel maps, and the selection
// of effects.
//
// A cell is a block of frames times a block of pixels of one recording. Every second cell is held out: excluded from
// fits, and the only data from which gaps and gains are computed.
#pragma once

#include "src/diagnose/effect.hpp"

namespace bolo::diagnose {

inline constexpr int kCellFrames = 24;  // at most
// Frames of a cell: 0.12 s, since short captures of slow cameras have too few longer ones. Thread: any.
Index cell_frames(const Session& session);

// `cell`: index of a block of cell_frames() frames. `pixel`: index within the grid.
bool held_out(const Session& session, Index cell, int pixel);

// Squared residuals on held-out cells, in units of the noise floor. A group is a block of frames of one recording.
struct Score {
  struct Group {
    double sum = 0.0;
    double count = 0.0;
    std::size_t recording = 0;
  };
  std::vector<Group> groups;
  // Root mean square, of one recording or of all.
  double gap(std::optional<std::size_t> recording = std::nullopt) const;
};

// Gain of log-likelihood between two scores, and its consistency over groups.
struct Gain {
  double total = 0.0;
  double z = 0.0;
};
Gain gain_of(std::span<const double> parts);  // one part per group
// For all recordings, or for one.
Gain gain_between(const Score& before, const Score& after, std::optional<std::size_t> recording = std::nullopt);

// Calls work(i) for each recording that has a model, on at most `threads` threads. `work` must not throw.
void for_each_modelled(const Session& session, int threads, const std::function<void(std::size_t)>& work);

// A session with its noise floor (K rms of one value) and the pixels to use. The session must outlive it.
struct FitData {
  FitData(const Session& session, double floor_k, int threads);

  const Session& session;
  double floor_k;
  int threads;
  std::vector<int> fit_pixels;  // a scattered subset of all_pixels, used by fits
  std::vector<int> all_pixels;  // good pixels away from the sensor's edge

  bool frame_counts(std::size_t recording, Index frame) const;
  // Residual of a recording at `pixels`, in units of the floor; 0 for unused frames and bad pixels.
  Series residual(std::size_t recording, const State& state, std::span<const int> pixels) const;
  Score score(const State& state) const;
  // Calls visit(frame, column, held_out) for each of all_pixels in the frames that count.
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

// Weighted residual and derivatives of one recording at the fitted pixels.
struct Columns {
  Series residual;
  std::vector<Series> column;             // empty: the parameter has no influence
  std::vector<double> shift;              // moving bars: each frame's shift fitted to the residual, px
  std::vector<std::vector<double>> turn;  // the same for each column
};
Columns columns_of(const FitData& data, std::size_t recording, const State& state,
                   const std::vector<Parameter>& parameters);

// Normal equations of a block of frames, for training and held-out cells: products of all columns, the residual last.
struct Group {
  MatrixXd train;
  MatrixXd test;
};

// One group per cell_frames() frames. Empty columns have no influence; `pixels` are those of the columns.
std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels);

// Solves within bounds: an unknown beyond a bound is clamped to it, as long as the others push it there.
VectorXd solve_within(const MatrixXd& normal, const VectorXd& right, const VectorXd& low, const VectorXd& high);

MatrixXd inverse(const MatrixXd& normal);
// Coefficients: a row per column of `basis`, a column per column of `values`.
MatrixXd least_squares(const MatrixXd& basis, const MatrixXd& values);

// Values of Nuisance::recording for parameters shared by recordings.
inline constexpr int kAllBars = -1;
inline constexpr int kAllRecordings = -2;

// An error of the stimulus: always fitted, never counted in the camera's gap.
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

// The common spread of the levels, as a share (at most 1) of the stated accuracy, estimated from all levels together.
inline constexpr double kLevelResolution = 0.005;  // K
double level_spread(const std::vector<Nuisance>& all, const State& state);
// Root mean square error of the levels, K.
double level_error(const std::vector<Nuisance>& all, const State& state);

// Log-likelihood (up to a constant) of the levels' errors. Levels of the same stated temperature that agree count once:
// the error of a black body at a set point is the same in every capture.
double level_evidence(const std::vector<Nuisance>& all, const State& state);

// Number of levels with independent errors: a set point counts once if a black body has the same error in all captures.
double independent_levels(const std::vector<Nuisance>& all, const State& state);

// Root mean square of the set points' errors relative to the stated accuracy of the bench; about 1 is usual.
double level_excess(const std::vector<Nuisance>& all, const State& state);

// An effect in one of its forms.
struct Choice {
  const Effect* effect = nullptr;
  const Form* form = nullptr;  // null: that of the state
};

// The same effects, without a form of their own.
std::vector<Choice> unformed(std::vector<Choice> choices);

struct Unknowns {
  std::vector<Nuisance> nuisances;
  std::vector<Parameter> parameters;  // of nuisances, then of the choices
  std::vector<std::size_t> first;     // parameter of each choice, and one past the last

  Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices);

  // The parameters for one recording, with step 0 if they have no influence on it. `of`: the parameters, or a superset.
  std::vector<Parameter> touching(const Session& session, std::size_t recording, std::vector<Parameter> of) const;

  // Adds the prior of the stimulus: its precision to the diagonal, its gradient to the right side.
  void add_prior(const State& state, MatrixXd& normal, VectorXd& right) const;
};

// The stimuli as described by their files, with the frame filter of `state`.
State nominal_of(const Session& session, const State& state);

inline constexpr std::array<MapKind, 4> kMapKinds{MapKind::kOffset, MapKind::kGain, MapKind::kTau, MapKind::kDrift};

// One value per kind, in that order.
template <typename T>
using OfMaps = std::array<T, kMapKinds.size()>;

// Derivatives of the readings with respect to the maps, frames x pixels: 1, T - the gains' reference, dT / d ln tau,
// the drift. Unwanted ones are empty. Thread: any.
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

// Sums of each pixel over all recordings; `sums_of(recording)` returns those of one recording.
std::vector<PixelSums> sum_pixels(const Session& session, std::size_t pixels, int threads,
                                  const std::function<std::vector<PixelSums>(std::size_t)>& sums_of);

// Centres the map over `pixels` and shrinks it by its reliability; `noise2` is the mean noise variance.
template <typename Map>
void centre_and_shrink(Map& map, std::span<const int> pixels, double noise2, MapKind kind) {
  constexpr double kSmallMean = 0.15;  // of a map's mean square: possible for a few smooth bumps
  const auto count = static_cast<double>(pixels.size());
  double mean = sum_of(pixels, [&](int p) { return map[p] / count; });
  const double square = sum_of(pixels, [&](int p) { return map[p] * map[p] / count; });
  // A small mean, as of a few smooth bumps, is kept. The mean of offsets belongs to the levels.
  if (kind != MapKind::kOffset && mean * mean < kSmallMean * square) mean = 0.0;
  using Value = typename Map::Scalar;
  for (const int p : pixels) map[p] -= static_cast<Value>(mean);
  const double variance = sum_of(pixels, [&](int p) { return map[p] * map[p] / count; });
  map *= static_cast<Value>(variance > 0.0 ? std::clamp(1.0 - noise2 / variance, 0.0, 1.0) : 0.0);
}

// The state with the maps that `choices` need, re-estimated from the training cells.
State estimate_maps(const FitData& data, State state, const std::vector<Choice>& choices);

// The score after adding a map of this kind to a state whose score is `before`.
Score map_gain(const FitData& data, const State& state, const Score& before, MapKind kind);

// Significance, in standard errors, of a parabola in the row means; columns may differ. Pixels of value 0 are ignored.
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

// Fits the stimulus, and the parameters and maps of `choices`, starting from `start`.
FitResult fit(const FitData& data, const State& start, const std::vector<Choice>& choices, int rounds);

// Repeats the fit, `rounds` at a time, until the gap changes by at most the fraction `tolerance`.
FitResult settle(const FitData& data, FitResult from, int rounds, double tolerance);

// Gain of each candidate on held-out cells, by the linear model around a fit: a cheap preselection for full fits.
std::vector<Gain> screen(const FitData& data, const FitResult& base, const std::vector<Choice>& candidates);

// Forward selection of effects with nested refits, followed by backward elimination.
struct Chosen {
  Choice choice;
  FoundEffect found;        // without its parameters
  bool from_map = false;    // found in the map of another effect, which had absorbed it
  Score before{}, after{};  // scores without and with it
};

struct Selection {
  FitResult fit;
  std::vector<Chosen> chosen;  // in order of selection; gaps are nested
};

// Minimum gain of an effect on held-out cells, in log-likelihood, and minimum consistency over groups.
inline constexpr double kLeastGain = 20.0;
inline constexpr double kLeastZ = 2.2;

// `allowed`: true for effects that may be selected. `progress` gets the effect being tried.
Selection select_effects(const FitData& data, const FitResult& base, const std::function<bool(const Effect&)>& allowed,
                         const Progress& progress);

}  // namespace bolo::diagnose
