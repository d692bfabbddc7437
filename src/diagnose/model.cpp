#include "src/diagnose/model.hpp"

#include <set>

namespace bolo::diagnose {
namespace {

// Converts the temperature of a black body to the linear quantity that the pixel follows.
double scene_signal(const CameraModel& c, double temperature_k) {
  double t = temperature_k;
  if (c.reflected != 0.0 || c.surroundings != 0.0) {
    t = band_temperature((1.0 - c.reflected) * band_signal(t) + c.reflected * band_signal(kSurroundings) +
                         c.surroundings);
  }
  return mixed_signal(t, c.radiance);
}

double row_time(const Session& session, const CameraModel& c, int row) {
  const int rows = c.two_halves ? row % std::max(1, session.height / 2) : row;
  return c.row_delay_s * rows * session.row_step;
}

std::vector<Step> steps_of(const capture::Chopper& chopper, const StimulusState& stimulus, const CameraModel& c) {
  constexpr int kParts = 12;  // steps that model a soft blade's edge
  const std::vector<double> levels = levels_of(chopper);
  std::vector<Step> steps;
  const double cold = scene_signal(c, stimulus.level_k[0]);
  const int parts = stimulus.softness_s > 1e-5 ? kParts : 1;
  const auto add = [&](double t_s, double height) {
    for (int i = 0; i < parts; ++i) {
      const double within = parts == 1 ? 0.0 : ((i + 0.5) / parts - 0.5) * stimulus.softness_s;
      steps.push_back({t_s + within, height / parts});
    }
  };
  for (std::size_t i = 0; i < chopper.on_s.size(); ++i) {
    const auto level = std::ranges::lower_bound(levels, chopper.level_k[i]) - levels.begin();
    const double height = scene_signal(c, stimulus.level_k[static_cast<std::size_t>(level) + 1]) - cold;
    add(chopper.on_s[i], height);
    add(chopper.off_s[i], -height);
  }
  std::ranges::sort(steps, {}, &Step::t_s);
  return steps;
}

void filter_frames(const Response& r, Series& y) {
  if (r.filter == FrameFilter::kNone || r.alpha >= 1.0) return;
  const auto alpha = static_cast<float>(r.alpha);
  const auto blend = [&](Index k) { y.row(k) = alpha * y.row(k) + (1.0F - alpha) * y.row(k - 1); };
  if (r.filter == FrameFilter::kRecursive) {
    for (Index k = 1; k < y.rows(); ++k) blend(k);
  } else {
    for (Index k = y.rows() - 1; k > 0; --k) blend(k);
  }
}

Series predict_chopper(const Session& session, std::size_t index, const State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  const auto& chopper = std::get<capture::Chopper>(recording.stimulus);
  const StimulusState& stimulus = state.stimuli[index];
  const CameraModel& c = state.camera;
  const std::vector<Step> steps = steps_of(chopper, stimulus, c);
  const double cold = scene_signal(c, stimulus.level_k[0]);
  const bool varied = c.tau.size() > 0;
  const StepResponse common(steps, c.response);
  Series y(recording.frames(), static_cast<Index>(pixels.size()));
  // Identical pixels sampled simultaneously share their values.
  const bool together = !varied && stimulus.sweep_s == 0.0 && c.row_delay_s == 0.0;
  for (Index j = 0; j < y.cols(); ++j) {
    if (together && j > 0) {
      y.col(j) = y.col(0);
      continue;
    }
    const int pixel = pixels[static_cast<std::size_t>(j)];
    const int row = session.grid.row_of(pixel);
    const double x = place_in(session, row, session.grid.column_of(pixel)).column - 0.5;
    const double shift = row_time(session, c, row) - stimulus.delay_s - stimulus.sweep_s * x;
    const StepResponse own = varied ? StepResponse(steps, c.response.slower(c.tau[pixel])) : common;
    for (Index k = 0; k < y.rows(); ++k) {
      const auto frame = static_cast<std::size_t>(k);
      const double t = recording.t[frame] * (1.0 + c.clock_skew) + stimulus.late_s[frame] + shift;
      y(k, j) = static_cast<float>(cold + own.at(t));
    }
  }
  filter_frames(c.response, y);
  return y;
}

Series predict_bars(const Session& session, std::size_t index, const State& state, std::span<const int> pixels) {
  const BarsModel model(session, index, state);
  const StimulusState& stimulus = state.stimuli[index];
  const bool still = session.recordings[index].kind == Kind::kStillBars;
  Series y(session.recordings[index].frames(), static_cast<Index>(pixels.size()));
  for (Index k = 0; k < y.rows(); ++k) {
    const auto frame = static_cast<std::size_t>(k);
    if (still && k > 0) {
      y.row(k) = y.row(0);
    } else {
      model.frame(frame, still ? stimulus.phase_px : stimulus.shift_px[frame], pixels, y.row(k).data(), nullptr);
    }
  }
  return y;
}

BarTables bar_tables(const CameraModel& c, const StimulusState& stimulus, const Bars& bars, bool moving) {
  const double cold = scene_signal(c, stimulus.level_k[0]);
  const double span = scene_signal(c, stimulus.level_k[1]) - cold;
  std::function<double(double)> signal;
  if (c.edges_in_temperature && (c.radiance != 0.0 || c.reflected != 0.0)) {
    signal = [&](double share) {
      const double kelvin = stimulus.level_k[0] + share * (stimulus.level_k[1] - stimulus.level_k[0]);
      return (scene_signal(c, kelvin) - cold) / span;
    };
  }
  return {BarShape(bars, c.response.blur_px2, signal), c.response, moving};
}

// Speeds are relative to the nominal clock: corrects them.
double true_mean_speed(const StimulusState& stimulus, double clock_skew) {
  const auto count = static_cast<double>(stimulus.speed_px_s.size());
  return sum_of(stimulus.speed_px_s, [count](double v) { return v / count; }) / (1.0 + clock_skew);
}

}  // namespace

Place place_in(const Session& session, int row, int column) {
  return {row / std::max(1.0, session.height - 1.0), column / std::max(1.0, session.width - 1.0)};
}

double corner_gain_at(const Session& session, const CameraModel& camera, int row, int column) {
  const double half_width = (session.width - 1) / 2.0;
  const double half_height = (session.height - 1) / 2.0;
  const double dx = column - half_width;
  const double dy = row - half_height;
  const double radius2 = (dx * dx + dy * dy) / std::max(1.0, half_width * half_width + half_height * half_height);
  const double gain = camera.corner_gain * radius2 + camera.tilt_x * dx / std::max(1.0, half_width) +
                      camera.tilt_y * dy / std::max(1.0, half_height);
  return gain * (1.0 + camera.corner_bend * radius2);
}

double heating_at(const CameraModel& camera, double row) {
  return camera.heating_k * std::expm1(-camera.heating_rate * row) / std::expm1(-camera.heating_rate);
}

double StimulusState::mean_speed() const { return sum_of(speed_px_s) / static_cast<double>(speed_px_s.size()); }

double drift_at(const CameraModel& camera, const Recording& recording, std::size_t index, double t_s) {
  const double s = 2.0 * t_s / std::max(1e-9, recording.t.back()) - 1.0;
  const auto& d = camera.drift[index];
  return d[0] * s + d[1] * (s * s - 1.0 / 3.0) + d[2] * (s * s * s - 0.6 * s);
}

std::vector<double> levels_of(const capture::Chopper& chopper) {
  const std::set<double> levels(chopper.level_k.begin(), chopper.level_k.end());
  return {levels.begin(), levels.end()};
}

State nominal_state(const Session& session, const model::CameraProfile& profile) {
  State state;
  state.camera.response.tau_s = profile.tau_s;
  state.camera.nominal_tau_s = profile.tau_s;
  state.camera.response.period_s = session.period_s;
  state.camera.row_delay_s = profile.row_delay_s;
  for (const Recording& recording : session.recordings) {
    StimulusState& s = state.stimuli.emplace_back();
    s.late_s.assign(static_cast<std::size_t>(recording.frames()), 0.0);
    if (const auto* uniform = std::get_if<capture::Uniform>(&recording.stimulus)) s.level_k = {uniform->temperature_k};
    if (const auto* chopper = std::get_if<capture::Chopper>(&recording.stimulus)) {
      s.level_k = {chopper->cold_k};
      for (const double level : levels_of(*chopper)) s.level_k.push_back(level);
    }
    if (const auto* bars = std::get_if<capture::BarTarget>(&recording.stimulus)) {
      s.level_k = {bars->cold_k, bars->hot_k};
      for (const double t : recording.t) {
        s.shift_px.push_back(bars->velocity_px_s * t);
        s.speed_px_s.push_back(bars->velocity_px_s);
      }
    }
  }
  return state;
}

bool has_bench(const Session& session) { return std::ranges::any_of(session.recordings, has_model); }

std::vector<std::size_t> modelled(const Session& session) {
  return places_where(session.recordings.size(), [&](std::size_t i) { return has_model(session.recordings[i]); });
}

Series predict_signal(const Session& session, std::size_t index, const State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  if (recording.kind == Kind::kChopper) return predict_chopper(session, index, state, pixels);
  if (recording.kind != Kind::kUniform) return predict_bars(session, index, state, pixels);
  return Series::Constant(recording.frames(), static_cast<Index>(pixels.size()),
                          static_cast<float>(scene_signal(state.camera, state.stimuli[index].level_k[0])));
}

Series read_out(const Session& session, std::size_t index, const CameraModel& c, std::span<const int> pixels,
                Series y) {
  const Recording& recording = session.recordings[index];
  if (c.radiance != 0.0) {
    const TemperatureTable temperature(c.radiance, y.minCoeff(), y.maxCoeff());
    for (float& v : y.reshaped()) v = static_cast<float>(temperature.at(v));
  }
  const bool plain = c.corner_gain == 0.0 && c.tilt_x == 0.0 && c.tilt_y == 0.0 && c.heating_k == 0.0 &&
                     c.offset.size() == 0 && c.gain.size() == 0 && c.terms.empty() && c.drift.empty();
  if (plain) return y;
  using Row = Eigen::Array<double, 1, Eigen::Dynamic>;
  Row gain = Row::Zero(y.cols());
  Row corner(y.cols());
  Row fixed(y.cols());
  Row share = Row::Zero(y.cols());  // relative excess of the drift
  std::vector<Place> places;
  for (Index j = 0; j < y.cols(); ++j) {
    const int pixel = pixels[static_cast<std::size_t>(j)];
    const int row = session.grid.row_of(pixel);
    const int column = session.grid.column_of(pixel);
    places.push_back(place_in(session, row, column));
    corner[j] = corner_gain_at(session, c, row, column);
    fixed[j] = heating_at(c, places.back().row);
    if (c.offset.size() > 0) fixed[j] += c.offset[pixel];
    if (c.gain.size() > 0) gain[j] = c.gain[pixel];
    if (c.drift_share.size() > 0) share[j] = c.drift_share[pixel];
  }
  for (Index k = 0; k < y.rows(); ++k) {
    const double t = recording.time_of(k);
    const Row shown = y.row(k).array().cast<double>();
    Row value = shown + gain * (shown - c.gain_reference_k) + corner * (shown - c.corner_reference_k) + fixed;
    if (!c.drift.empty()) {
      const double drifted = drift_at(c, recording, index, t);
      value += drifted;
      if (c.drift_share.size() > 0) value += share * (drifted + c.drift_level[index]);
    }
    for (Index j = 0; !c.terms.empty() && j < y.cols(); ++j) {
      const Place& place = places[static_cast<std::size_t>(j)];
      for (const CameraModel::Term& term : c.terms) value[j] += term.value * term.unit(place, shown[j]);
    }
    y.row(k) = value.cast<float>().matrix();
  }
  return y;
}

Series predict(const Session& session, std::size_t index, const State& state, std::span<const int> pixels) {
  return read_out(session, index, state.camera, pixels, predict_signal(session, index, state, pixels));
}

bool same_signal(std::size_t recording, const State& a, const State& b) {
  const Eigen::VectorXf& tau = a.camera.tau;
  const Eigen::VectorXf& other = b.camera.tau;
  const PixelModel& pixel = a.camera;
  return pixel == b.camera && a.stimuli[recording] == b.stimuli[recording] && a.edge_px == b.edge_px &&
         a.edge_ramp == b.edge_ramp && a.aperture_px == b.aperture_px && tau.size() == other.size() && tau == other;
}

VectorXd frame_means(const Session& session, std::size_t index, const State& state, std::span<const int> pixels) {
  return predict(session, index, state, pixels).rowwise().mean().cast<double>();
}

MatrixXd level_slopes(const Session& session, std::size_t index, const State& state, std::span<const int> pixels) {
  const VectorXd base = frame_means(session, index, state, pixels);
  MatrixXd slopes(base.size(), static_cast<Index>(state.stimuli[index].level_k.size()));
  for (Index l = 0; l < slopes.cols(); ++l) {
    State hotter = state;
    hotter.stimuli[index].level_k[static_cast<std::size_t>(l)] += 1.0;
    slopes.col(l) = frame_means(session, index, hotter, pixels) - base;
  }
  return slopes;
}

BarsModel::BarsModel(const Session& session, std::size_t recording, const State& state)
    : session_(session),
      camera_(state.camera),
      stimulus_(state.stimuli[recording]),
      target_(std::get<capture::BarTarget>(session.recordings[recording].stimulus)),
      moving_(session.recordings[recording].kind == Kind::kMovingBars),
      mean_speed_(moving_ ? true_mean_speed(stimulus_, camera_.clock_skew) : 0.0),
      cold_(scene_signal(camera_, stimulus_.level_k[0])),
      span_(scene_signal(camera_, stimulus_.level_k[1]) - cold_),
      tables_(bar_tables(camera_, stimulus_,
                         {target_.period_px, target_.bar_width_px, target_.slant_px_per_row, mean_speed_,
                          (1.0 - state.edge_ramp) * (state.edge_px * state.edge_px),
                          std::sqrt(12.0 * state.edge_ramp * (state.edge_px * state.edge_px)), state.aperture_px},
                         moving_)) {
  for (const int pixel : session_.grid.all()) {
    const int row = session_.grid.row_of(pixel);
    places_.push_back(
        {session_.grid.column_of(pixel) - target_.slant_px_per_row * row, row_time(session_, camera_, row)});
  }
}

void BarsModel::frame(std::size_t k, double shift_px, std::span<const int> pixels, float* values, float* slopes) const {
  const double speed = moving_ ? stimulus_.speed_px_s[k] / (1.0 + camera_.clock_skew) : 0.0;
  const double log_speed = moving_ ? std::clamp(speed / mean_speed_ - 1.0, -0.1, 0.1) : 0.0;
  for (std::size_t j = 0; j < pixels.size(); ++j) {
    const Place& place = places_[static_cast<std::size_t>(pixels[j])];
    const double u = place.x - shift_px - speed * place.late_s;
    const double own = log_speed + (camera_.tau.size() > 0 ? camera_.tau[pixels[j]] : 0.0);
    values[j] = static_cast<float>(cold_ + span_ * tables_.at(u, own));
    if (slopes != nullptr) slopes[j] = static_cast<float>(-span_ * tables_.middle().slope(u));
  }
}

}  // namespace bolo::diagnose
