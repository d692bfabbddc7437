// Nested least-squares fits of camera and stimulus: what they look at and its linear equations, what they solve for,
// maps of single pixels, and the choice of effects.
//
// A cell is a block of frames times a block of pixels of one recording. Every second cell is held out: it never enters
// a fit, and gaps and gains are measured there only.
#pragma once

#include "src/diagnose/effect.hpp"

namespace bolo::diagnose {

using Eigen::MatrixXd;
using Eigen::VectorXd;

inline constexpr int kCellFrames = 24;

// Pixel: index within the grid.
bool held_out(const Session& session, Index frame, int pixel);

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

// Gain of log-likelihood from one score to another and how consistent it is over groups.
struct Gain {
  double total = 0.0;
  double z = 0.0;
};
Gain gain_of(std::span<const double> parts);  // one of each group
Gain gain_between(const Score& before, const Score& after);

// Calls work(i) for each recording that has a model, on at most `threads` threads. It must not throw.
void for_each_modelled(const Session& session, int threads, const std::function<void(std::size_t)>& work);

// A session with the noise of one value (K rms) and the pixels that are looked at; the session must outlive it.
struct FitData {
  FitData(const Session& session, double floor_k, int threads);

  const Session& session;
  double floor_k;
  int threads;
  std::vector<int> fit_pixels;  // that fits look at: a scattered part of
  std::vector<int> all_pixels;  // all that are good and not at the sensor's edge

  bool frame_counts(std::size_t recording, Index frame) const;
  // Below it a value is what the camera would have shown without a ceiling.
  float usable_limit(const State& state) const;
  // Residual of a recording in units of the floor, on `pixels`; unused frames and bad pixels are 0.
  Series residual(std::size_t recording, const State& state, std::span<const int> pixels) const;
  Score score(const State& state) const;
  // Calls visit(frame, column, is held out) for each of all_pixels in the frames that count.
  template <typename Visit>
  void for_each_value(std::size_t recording, const Visit& visit) const {
    for (Index k = 0; k < session.recordings[recording].frames(); ++k) {
      if (!frame_counts(recording, k)) continue;
      for (std::size_t j = 0; j < all_pixels.size(); ++j) {
        visit(k, static_cast<Index>(j), held_out(session, k, all_pixels[j]));
      }
    }
  }
};

// Weighted residual and derivatives of one recording on the fit's pixels.
struct Columns {
  Series residual;
  std::vector<Series> column;             // empty where the parameter has no influence
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

// One group for each kCellFrames frames. An empty column is one without influence; `pixels` are those of the columns.
std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels);

// The solution within bounds: what would go beyond one stays there, and the others are solved for once more.
VectorXd solve_within(const MatrixXd& normal, const VectorXd& right, const VectorXd& low, const VectorXd& high);

MatrixXd inverse(const MatrixXd& normal);
// What each column of the basis counts in each column of values.
MatrixXd least_squares(const MatrixXd& basis, const MatrixXd& values);

// Owners of what several recordings share.
inline constexpr int kAllBars = -1;
inline constexpr int kAllRecordings = -2;

// An error of the stimulus, fitted always and never counted as the camera's gap.
struct Nuisance {
  Parameter parameter;
  int recording = kAllBars;
  bool is_level = false;  // shares its prior with all other levels
  double nominal = 0.0;
  double prior =
      0.0;  // standard deviation about `nominal`; 0: free. Of levels: what the bench says, see level_spread()
};

std::vector<Nuisance> nuisances(const Session& session, const State& nominal);

inline constexpr double kSoftestEdge_px = 0.35;  // of a target, standard deviation

// Levels that agree with the files to a few millikelvin say so together: their spread, as a share of what the bench
// says of their accuracy, is estimated from themselves, but is never more than all of it.
inline constexpr double kLevelResolution = 0.005;  // K
double level_spread(const std::vector<Nuisance>& all, const State& state);
// The standard deviation of one level at this spread, K.
double level_width(const Nuisance& level, double spread);
// Root mean square of the levels' errors, K.
double level_error(const std::vector<Nuisance>& all, const State& state);

// Log-likelihood (up to a constant) of the levels' errors.
double level_evidence(const std::vector<Nuisance>& all, const State& state);

// An effect in one of its forms.
struct Choice {
  const Effect* effect = nullptr;
  int form = -1;  // -1: as the state has it
};

// The same effects, their forms as they are in the state already.
std::vector<Choice> unformed(std::vector<Choice> choices);

struct Unknowns {
  std::vector<Nuisance> nuisances;
  std::vector<Parameter> parameters;  // of nuisances, then of the choices
  std::vector<std::size_t> first;     // of each choice, and one past the last

  Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices);

  // Of one recording: those that cannot change it have no step. `of`: the parameters, or these and more.
  std::vector<Parameter> touching(const Session& session, std::size_t recording, std::vector<Parameter> of) const;

  // The prior of the stimulus: precision on the diagonal, and its pull on the right side.
  void add_prior(const State& state, MatrixXd& normal, VectorXd& right) const;
};

// What the files say of the stimuli, with the frame filter of `state`.
State nominal_of(const Session& session, const State& state);

inline constexpr std::array<MapKind, 4> kMapKinds{MapKind::kOffset, MapKind::kGain, MapKind::kTau, MapKind::kDrift};

// One of each kind, in that order.
template <typename T>
using OfMaps = std::array<T, kMapKinds.size()>;

// What maps do to the readings: frames x pixels, per unit: 1, T - the gains' reference, dT / d ln tau, the drift. Those
// that are not wanted are empty. Thread: any.
OfMaps<Series> bases_of(const Session& session, std::size_t recording, const State& state, const OfMaps<bool>& wanted,
                        std::span<const int> pixels);

// The regression of one pixel's residual on the bases that are wanted.
struct PixelSums {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  double squares = 0.0;
  double count = 0.0;

  void add(const OfMaps<Series>& bases, Index frame, Index column, double residual);
  // The inverse of `normal`; what is not wanted, or not known, comes out as 0.
  Eigen::Matrix4d spread(const OfMaps<bool>& wanted) const;
};

// Each pixel's sums over all recordings; `sums_of(recording)` has those of one, a value for each of `pixels`.
std::vector<PixelSums> sum_pixels(const Session& session, std::size_t pixels, int threads,
                                  const std::function<std::vector<PixelSums>(std::size_t)>& sums_of);

// Makes the mean over the pixels that count zero, and keeps as much of their scatter as is not noise: `noise2` is its
// mean variance.
template <typename Map>
void centre_and_shrink(Map& map, std::span<const int> pixels, double noise2, MapKind kind) {
  constexpr double kSmallMean = 0.15;  // of a map's squares: a mean that a few smooth bumps may have
  const auto count = static_cast<double>(pixels.size());
  double mean = sum_of(pixels, [&](int p) { return map[p] / count; });
  const double square = sum_of(pixels, [&](int p) { return map[p] * map[p] / count; });
  // A few smooth bumps need not have zero mean: a small one is theirs. Offsets' mean belongs to the levels.
  if (kind != MapKind::kOffset && mean * mean < kSmallMean * square) mean = 0.0;
  using Value = typename Map::Scalar;
  for (const int p : pixels) map[p] -= static_cast<Value>(mean);
  const double variance = sum_of(pixels, [&](int p) { return map[p] * map[p] / count; });
  map *= static_cast<Value>(variance > 0.0 ? std::clamp(1.0 - noise2 / variance, 0.0, 1.0) : 0.0);
}

// The state with the maps that `choices` want, estimated anew on the training cells.
State estimate_maps(const FitData& data, State state, const std::vector<Choice>& choices);

// The score with a map of this kind added to a state whose score is `before`.
Score map_gain(const FitData& data, const State& state, const Score& before, MapKind kind);

// By how many standard errors the means of rows follow a parabola over the rows. Columns may differ; pixels of 0 do not
// count.
double row_trend_z(const Session& session, const Eigen::VectorXf& map);

// Above it the rows' means are no accident.
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

// Once more, `rounds` at a time, until the gap changes by no more than the share `tolerance`.
FitResult settle(const FitData& data, FitResult from, int rounds, double tolerance);

// What each candidate would gain on held-out cells, by the linear model around a fit: cheap, so that only the best are
// fitted in earnest.
std::vector<Gain> screen(const FitData& data, const FitResult& base, const std::vector<Choice>& candidates);

// Forward selection of effects with nested refits, then backward.
struct Chosen {
  Choice choice;
  FoundEffect found;      // without its parameters
  bool from_map = false;  // seen in the map of another, which had explained it away
};

struct Selection {
  FitResult fit;
  std::vector<Chosen> chosen;  // in the order of finding; gaps are nested
};

// What an effect must gain on held-out cells, in units of log-likelihood, and how even over groups.
inline constexpr double kLeastGain = 20.0;
inline constexpr double kLeastZ = 2.2;

// `allowed` says which effects of the catalogue may be chosen at all. `progress` is told what is being tried.
Selection select_effects(const FitData& data, const FitResult& base, const std::function<bool(const Effect&)>& allowed,
                         const std::function<bool(const std::string& step, double done)>& progress);

}  // namespace bolo::diagnose
