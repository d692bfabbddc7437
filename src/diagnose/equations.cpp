// The unknowns of a fit and its normal equations.
#include "src/core/threads.hpp"
#include "src/diagnose/fit.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kLevelReach = 30.0;          // K
constexpr double kEdgePrior = 0.2;            // px
constexpr double kShapePrior = 0.5;           // covers both a Gaussian and a straight ramp
constexpr double kAperturePrior = 0.15;       // px
constexpr double kSmallestAperture_px = 0.6;  // a fill factor of 0.36
constexpr int kFitPixels = 288;
constexpr int kBorder = 2;               // pixels at the sensor's edge, whose neighbours the model does not know
constexpr double kClearOfCeiling = 4.0;  // noise floors: values closer below a ceiling are not used
constexpr double kPriorFloor = 1e-12;
constexpr double kCell_s = 0.12;       // kCellFrames at 200 Hz
constexpr Index kFewestOfCell = 6;     // frames
constexpr double kLeastPull = 1e-6;    // smallest gain in log-likelihood that frees an unknown from its bound
constexpr float kLeastSlope = 100.0F;  // squared slope in units of the noise: minimum to estimate a frame's time

// The temperature accuracy that the bench states, K.
double accuracy_of(const capture::Stimulus& stimulus) {
  return std::visit(
      [](const auto& of) {
        if constexpr (requires { of.level_accuracy_k; }) return of.level_accuracy_k;
        return capture::kLevelAccuracyK;
      },
      stimulus);
}

bool touches(int owner, const Session& session, std::size_t recording) {
  if (owner == kAllRecordings) return true;
  if (owner >= 0) return static_cast<std::size_t>(owner) == recording;
  return is_bars(session.recordings[recording].kind);
}

// Standard deviation of one level, K, at this spread.
double level_width(const Nuisance& level, double spread) { return std::hypot(spread * level.prior, kLevelResolution); }

// Values below this limit are unaffected by the ceiling.
float usable_limit(const FitData& data, const State& state) {
  return static_cast<float>(state.camera.clip_k - kClearOfCeiling * data.floor_k);
}

// Adds one group's frames to two augmented normal matrices, train and test. In double: derivatives by levels and by
// emissivity differ by less than the rounding error of float sums.
void add_group(const Session& session, const Series& residual, const std::vector<Series>& columns,
               std::span<const int> pixels, Index from, Index to, Group& group) {
  std::vector<Index> present;
  std::vector<const Series*> sources;
  for (std::size_t j = 0; j <= columns.size(); ++j) {
    const Series& source = j == columns.size() ? residual : columns[j];
    if (source.size() == 0) continue;
    present.push_back(static_cast<Index>(j));
    sources.push_back(&source);
  }
  std::array<std::vector<Index>, 2> cells;  // pixels of the group's train and test cells
  const Index cell = from / cell_frames(session);
  for (std::size_t p = 0; p < pixels.size(); ++p) {
    cells[held_out(session, cell, pixels[p]) ? 1 : 0].push_back(static_cast<Index>(p));
  }
  for (const std::size_t side : {0U, 1U}) {
    MatrixXd x(static_cast<Index>(cells[side].size()) * (to - from), static_cast<Index>(present.size()));
    for (std::size_t j = 0; j < sources.size(); ++j) {
      Index at = 0;
      for (Index k = from; k < to; ++k) {
        for (const Index p : cells[side]) x(at++, static_cast<Index>(j)) = (*sources[j])(k, p);
      }
    }
    MatrixXd products = MatrixXd::Zero(x.cols(), x.cols());
    products.selfadjointView<Eigen::Lower>().rankUpdate(x.transpose());
    (side == 0 ? group.train : group.test)(present, present) += MatrixXd(products.selfadjointView<Eigen::Lower>());
  }
}

// Solves with the diagonal scaled to 1 and a tiny ridge: unknowns without data become zero.
MatrixXd solve(const MatrixXd& normal, const MatrixXd& right) {
  const VectorXd scale = normal.diagonal().cwiseMax(kPriorFloor).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  scaled.diagonal().array() += 1e-13;
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * right);
}

// Derivatives of a frame's values, K, by the target's shift (moving bars, px) or the frame's delay (chopper, s).
Series slopes_of(const Session& session, std::size_t recording, const State& state, std::span<const int> pixels,
                 const Series& base) {
  if (session.recordings[recording].kind == Kind::kMovingBars) {
    const BarsModel model(session, recording, state);
    Series slopes(base.rows(), base.cols());
    Eigen::RowVectorXf value(base.cols());
    for (Index k = 0; k < base.rows(); ++k) {
      const auto frame = static_cast<std::size_t>(k);
      model.frame(frame, state.stimuli[recording].shift_px[frame], pixels, value.data(), slopes.row(k).data());
    }
    return slopes;
  }
  constexpr double kStep = 3e-4;  // wide enough to include an edge just after a frame
  State later = state;
  State earlier = state;
  for (double& late : later.stimuli[recording].late_s) late += kStep;
  for (double& late : earlier.stimuli[recording].late_s) late -= kStep;
  return (predict(session, recording, later, pixels) - predict(session, recording, earlier, pixels)) *
         static_cast<float>(0.5 / kStep);
}

// Every frame's shift is free: projects it out of the residual and all columns.
void take_out_shifts(const FitData& data, std::size_t recording, const Series& slopes, Columns& c) {
  c.shift.assign(static_cast<std::size_t>(slopes.rows()), 0.0);
  c.turn.assign(c.column.size(), c.shift);
  for (Index k = 0; k < slopes.rows(); ++k) {
    const auto frame = static_cast<std::size_t>(k);
    const Eigen::RowVectorXf slope = slopes.row(k);
    const float norm = slope.squaredNorm();
    if (!data.frame_counts(recording, k) || norm < kLeastSlope) continue;
    const auto take_out = [&](Series& of) {
      const float share = of.row(k).dot(slope) / norm;
      of.row(k) -= share * slope;
      return share;
    };
    c.shift[frame] = take_out(c.residual);
    for (std::size_t j = 0; j < c.column.size(); ++j) {
      if (c.column[j].size() > 0) c.turn[j][frame] = take_out(c.column[j]);
    }
  }
}

}  // namespace

std::vector<Nuisance> nuisances(const Session& session, const State& nominal) {
  std::vector<Nuisance> all;
  bool bars = false;
  for (const std::size_t i : modelled(session)) {
    const Recording& recording = session.recordings[i];
    const StimulusState& stimulus = nominal.stimuli[i];
    const auto add = [&](Parameter parameter, double prior) {
      all.push_back({std::move(parameter), static_cast<int>(i), false, 0.0, prior});
    };
    const auto member = [i](std::string name, double StimulusState::*field, double step, double reach) {
      return number_at(
          std::move(name), step, -reach, reach, [=](auto& s) -> auto& { return s.stimuli[i].*field; });
    };
    for (std::size_t l = 0; l < stimulus.level_k.size(); ++l) {
      const double level = stimulus.level_k[l];
      all.push_back({number_at(
                         "level", 1.0, level - kLevelReach, level + kLevelReach,
                         [ i, l ](auto& s) -> auto& { return s.stimuli[i].level_k[l]; }),
                     static_cast<int>(i), true, level, accuracy_of(recording.stimulus)});
    }
    if (recording.kind == Kind::kChopper) {
      // With free frame times, a common delay is not an unknown.
      const bool common = !stimulus.times_free;
      if (common) add(member("delay", &StimulusState::delay_s, 0.0005, 0.05), 0.0);
      add(member("sweep", &StimulusState::sweep_s, 0.001, 0.03), 0.005);
      // The square of the softness, s^2: a symmetric ramp changes the response in second order only.
      const auto softness = [i](auto& s) -> auto& { return s.stimuli[i].softness_s; };
      if (common) add(square_of("softness", 1e-6, 2.5e-5, softness), 2e-6);
    }
    if (recording.kind == Kind::kStillBars) add(member("phase", &StimulusState::phase_px, 0.05, 1e6), 0.0);
    bars = bars || is_bars(recording.kind);
  }
  if (nominal.camera.response.filter != FrameFilter::kNone && nominal.camera.response.alpha < 1.0) {
    // The noise determines alpha to a percent; the delayed edges are more precise.
    all.push_back({number_of("alpha", 0.02, 0.05, 1.0, &Response::alpha), kAllRecordings, false, 1.0, 0.0});
  }
  if (bars) {
    const auto width = number_at(
        "edge", 0.04, 0.0, kSoftestEdge_px, [](auto& s) -> auto& { return s.edge_px; });
    const auto shape = number_at(
        "edge_ramp", 0.2, 0.0, 1.0, [](auto& s) -> auto& { return s.edge_ramp; });
    all.push_back({width, kAllBars, false, 0.0, kEdgePrior});
    all.push_back({shape, kAllBars, false, 0.5, kShapePrior});
    const auto aperture = number_at(
        "aperture", 0.05, kSmallestAperture_px, 1.0, [](auto& s) -> auto& { return s.aperture_px; });
    all.push_back({aperture, kAllBars, false, 1.0, kAperturePrior});
  }
  return all;
}

std::vector<Choice> unformed(std::vector<Choice> choices) {
  for (Choice& c : choices) c.form = nullptr;
  return choices;
}

Unknowns::Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices)
    : nuisances(diagnose::nuisances(session, nominal)), parameters(mapped(nuisances, &Nuisance::parameter)) {
  for (const Choice& choice : choices) {
    first.push_back(parameters.size());
    for (Parameter& c : choice.effect->parameters(session)) parameters.push_back(std::move(c));
  }
  first.push_back(parameters.size());
}

std::vector<Parameter> Unknowns::touching(const Session& session, std::size_t recording,
                                          std::vector<Parameter> of) const {
  for (std::size_t j = 0; j < nuisances.size(); ++j) {
    if (!touches(nuisances[j].recording, session, recording)) of[j].step = 0.0;
  }
  return of;
}

void Unknowns::add_prior(const State& state, MatrixXd& normal, VectorXd& right) const {
  const double spread = level_spread(nuisances, state);
  for (std::size_t i = 0; i < nuisances.size(); ++i) {
    const Nuisance& n = nuisances[i];
    const double width = n.is_level ? level_width(n, spread) : n.prior;
    if (width <= 0.0) continue;
    const auto j = static_cast<Index>(i);
    normal(j, j) += 1.0 / (width * width);
    right[j] += (n.nominal - n.parameter.get(state)) / (width * width);
  }
}

State nominal_of(const Session& session, const State& state) {
  State nominal = nominal_state(session, {});
  nominal.camera.response.filter = state.camera.response.filter;
  nominal.camera.response.alpha = state.camera.response.alpha;
  for (std::size_t i = 0; i < nominal.stimuli.size(); ++i) nominal.stimuli[i].times_free = state.stimuli[i].times_free;
  return nominal;
}

Index cell_frames(const Session& session) {
  return std::clamp<Index>(std::lround(kCell_s / session.period_s), kFewestOfCell, kCellFrames);
}

bool held_out(const Session& session, Index cell, int pixel) {
  const auto width = static_cast<int>(session.grid.columns.size());
  const int block = pixel / width / 4 + pixel % width / 4;
  return ((cell + block) & 1) != 0;
}

double Score::gap(std::optional<std::size_t> recording) const {
  double sum = 0.0;
  double count = 0.0;
  for (const Group& g : groups) {
    if (recording && g.recording != *recording) continue;
    sum += g.sum;
    count += g.count;
  }
  return count > 0.0 ? std::sqrt(sum / count) : 1.0;
}

Gain gain_of(std::span<const double> parts) {
  const double total = sum_of(parts);
  const double squares = sum_of(parts, [](double part) { return part * part; });
  return {total, squares > 0.0 ? total / std::sqrt(squares) : 0.0};
}

Gain gain_between(const Score& before, const Score& after, std::optional<std::size_t> recording) {
  std::vector<double> parts;
  for (std::size_t g = 0; g < before.groups.size(); ++g) {
    if (recording && before.groups[g].recording != *recording) continue;
    parts.push_back((before.groups[g].sum - after.groups[g].sum) / 2.0);
  }
  return gain_of(parts);
}

FitData::FitData(const Session& of, double floor, int most_threads)
    : session(of), floor_k(floor), threads(most_threads), all_pixels(of.good_pixels()) {
  const auto at_border = [](int place, int size) { return place < kBorder || place >= size - kBorder; };
  if (session.width > 12 && session.height > 12) {
    std::erase_if(all_pixels, [&](int p) {
      return at_border(session.grid.row_of(p), session.height) || at_border(session.grid.column_of(p), session.width);
    });
  }
  // A scattered subset, the same in every run.
  fit_pixels = all_pixels;
  std::ranges::sort(fit_pixels, {}, [](int p) { return static_cast<std::uint32_t>(p) * 2654435761U; });
  if (fit_pixels.size() > kFitPixels) fit_pixels.resize(kFitPixels);
  std::ranges::sort(fit_pixels);
}

bool FitData::frame_counts(std::size_t recording, Index frame) const {
  const Recording& r = session.recordings[recording];
  return r.is_used(frame) && (r.kind != Kind::kMovingBars || r.time_of(frame) >= kSettling_s);
}

void for_each_modelled(const Session& session, int threads, const std::function<void(std::size_t)>& work) {
  const std::vector<std::size_t> recordings = modelled(session);
  share_out(recordings.size(), static_cast<std::size_t>(threads), [&](std::size_t i) { work(recordings[i]); });
}

Series FitData::residual(std::size_t recording, const State& state, std::span<const int> pixels) const {
  const Recording& r = session.recordings[recording];
  Series y = predict(session, recording, state, pixels);
  const float limit = usable_limit(*this, state);
  for (Index k = 0; k < y.rows(); ++k) {
    const bool counts = frame_counts(recording, k);
    for (Index j = 0; j < y.cols(); ++j) {
      const int pixel = pixels[static_cast<std::size_t>(j)];
      const bool clipped = y(k, j) > limit || r.values(k, pixel) > limit;
      const bool usable = counts && session.is_good(pixel) && !clipped;
      y(k, j) = usable ? (r.values(k, pixel) - y(k, j)) / static_cast<float>(floor_k) : 0.0F;
    }
  }
  return y;
}

Score FitData::score(const State& state) const {
  std::vector<Score> parts(session.recordings.size());
  const bool limited = std::isfinite(state.camera.clip_k);
  const Index cell = cell_frames(session);
  for_each_modelled(session, threads, [&](std::size_t i) {
    const Series r = residual(i, state, all_pixels);
    parts[i].groups.resize(static_cast<std::size_t>((r.rows() + cell - 1) / cell), {0.0, 0.0, i});
    for_each_value(i, [&](Index k, Index j, bool held) {
      const double value = r(k, j);
      if (!held || (limited && value == 0.0)) return;
      Score::Group& group = parts[i].groups[static_cast<std::size_t>(k / cell)];
      group.sum += value * value;
      group.count += 1.0;
    });
  });
  Score all;
  for (const Score& part : parts) all.groups.insert(all.groups.end(), part.groups.begin(), part.groups.end());
  return all;
}

Columns columns_of(const FitData& data, std::size_t recording, const State& state,
                   const std::vector<Parameter>& parameters) {
  const Recording& r = data.session.recordings[recording];
  const Series seen = r.values(Eigen::all, data.fit_pixels);
  const Series signal = predict_signal(data.session, recording, state, data.fit_pixels);
  const Series base = read_out(data.session, recording, state.camera, data.fit_pixels, signal);
  const auto weight = static_cast<float>(1.0 / data.floor_k);
  const float limit = usable_limit(data, state);
  const bool limited = std::isfinite(state.camera.clip_k);
  const auto without_clipped = [&](Series& of) {
    if (limited) of.array() *= (seen.array() <= limit && base.array() <= limit).cast<float>();
  };
  Columns c;
  c.residual = (seen - base) * weight;
  without_clipped(c.residual);
  for (const Parameter& parameter : parameters) {
    Series& column = c.column.emplace_back();
    if (parameter.step == 0.0) continue;  // not an unknown of this recording
    State moved = state;
    const double at = parameter.get(state);
    const double step = at + parameter.step > parameter.high ? -parameter.step : parameter.step;
    parameter.set(moved, at + step);
    const Series value = same_signal(recording, state, moved)
                             ? read_out(data.session, recording, moved.camera, data.fit_pixels, signal)
                             : predict(data.session, recording, moved, data.fit_pixels);
    column = (value - base) * (weight / static_cast<float>(step));
    without_clipped(column);
  }
  for (Index k = 0; k < base.rows(); ++k) {
    if (data.frame_counts(recording, k)) continue;
    c.residual.row(k).setZero();
    for (Series& column : c.column) {
      if (column.size() > 0) column.row(k).setZero();
    }
  }
  if (r.kind != Kind::kMovingBars && !state.stimuli[recording].times_free) return c;
  Series slopes = slopes_of(data.session, recording, state, data.fit_pixels, base) * weight;
  without_clipped(slopes);
  take_out_shifts(data, recording, slopes, c);
  return c;
}

std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels) {
  std::vector<Group> groups;
  const auto size = static_cast<Index>(columns.size()) + 1;
  const Index cell = cell_frames(session);
  for (Index from = 0; from < residual.rows(); from += cell) {
    const Index to = std::min(residual.rows(), from + cell);
    Group& group = groups.emplace_back(Group{MatrixXd::Zero(size, size), MatrixXd::Zero(size, size)});
    add_group(session, residual, columns, pixels, from, to, group);
  }
  return groups;
}

VectorXd solve_within(const MatrixXd& normal, const VectorXd& right, const VectorXd& low, const VectorXd& high) {
  const Index n = right.size();
  std::vector<Index> free(static_cast<std::size_t>(n));
  std::iota(free.begin(), free.end(), 0);
  std::vector<Index> held;
  VectorXd x = VectorXd::Zero(n);
  for (int round = 0; round < 12; ++round) {
    VectorXd b = right(free);
    std::ranges::sort(held);
    for (const Index j : held) b -= normal(free, j) * x[j];
    const VectorXd solved = solve(normal(free, free), b);
    std::vector<Index> still_free;
    for (std::size_t r = 0; r < free.size(); ++r) {
      const Index j = free[r];
      const double wanted = solved[static_cast<Index>(r)];
      x[j] = std::clamp(wanted, low[j], high[j]);
      (x[j] == wanted ? still_free : held).push_back(j);
    }
    if (still_free.size() == free.size()) {
      // An unknown clamped together with another may have to be freed again: its gradient points inwards.
      const VectorXd pull = right - normal * x;
      const auto back = std::ranges::find_if(held, [&](Index j) {
        return pull[j] * pull[j] > kLeastPull * normal(j, j) && (pull[j] > 0.0 ? x[j] < high[j] : x[j] > low[j]);
      });
      if (back == held.end()) break;
      still_free.push_back(*back);
      held.erase(back);
    }
    free = std::move(still_free);
  }
  return x;
}

MatrixXd inverse(const MatrixXd& normal) { return solve(normal, MatrixXd::Identity(normal.rows(), normal.cols())); }

}  // namespace bolo::diagnose
