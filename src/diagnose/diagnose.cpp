#include "bolo/diagnose/diagnose.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>

#include "events.hpp"
#include "learn.hpp"
#include "noise.hpp"
#include "omnibus.hpp"
#include "plots.hpp"
#include "select.hpp"
#include "transport.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kLeastCorrelation = 0.6;  // of a recording with its stimulus

class Diagnosis {
 public:
  Diagnosis(Session session, const Options& options, const Progress& progress)
      : session_(std::move(session)), options_(options), progress_(progress) {}

  Result<Report> run();
  Result<Learned> learn(const std::vector<std::filesystem::path>& captures, const Report& report) const;

 private:
  bool allowed(const std::string& name) const { return std::ranges::count(options_.withheld, name) == 0; }
  void remain(const std::string& stage, const std::string& where, double z) {
    remainders_.push_back({stage, where, z});
  }
  // An effect with statistics of its own: named, or, when it is withheld, left over.
  void found(FoundEffect effect, double z, const std::string& where);
  void judge_events();
  void judge_noise();
  void judge_values();
  Result<bool> judge_means();
  void correct_jumps(const State& state);
  void conclude();

  Session session_;
  Session raw_;  // before anything was taken out
  const Options& options_;
  const Progress& progress_;
  Report report_;
  std::vector<Freeze> freezes_;
  std::vector<std::size_t> repeated_;
  std::vector<Jump> jumps_;
  BadPixels bad_;
  NoiseStatistics noise_;
  double floor_k_ = 0.03;
  double ceiling_k_ = std::numeric_limits<double>::infinity();
  State state_;
  State nominal_;
  std::vector<Remainder> remainders_;
  bool fitted_ = false;
  bool coarse_ = false;
};

double nominal_noise(const model::CameraProfile& p) {
  return std::sqrt(p.noise_k * p.noise_k + p.quantisation_k * p.quantisation_k / 12.0);
}

FoundEffect named(const std::string& name, double confidence) {
  FoundEffect e;
  e.name = name;
  e.stage = find_effect(name)->stage;
  e.confidence = confidence;
  return e;
}

double confidence_from(double z) { return 1.0 - 0.5 * std::erfc(std::min(z, 6.0) / 2.0); }

void Diagnosis::found(FoundEffect effect, double z, const std::string& where) {
  if (allowed(effect.name)) {
    report_.effects.push_back(std::move(effect));
  } else {
    remain(effect.stage, where, z);
  }
}

void Diagnosis::judge_events() {
  raw_ = session_;
  freezes_ = find_freezes(session_, repeated_);
  bad_ = find_dead_pixels(session_);
  const double step = find_step(session_);
  for (const Recording& r : session_.recordings) ceiling_k_ = std::min(ceiling_k_, find_ceiling(r, step));
  // In a field recording what moves is not known, so that steps of the scene would be taken for jumps.
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    if (session_.recordings[i].kind != Kind::kUniform) continue;
    for (Jump& jump : find_jumps(session_, i, session_.recordings[i].values, freezes_)) {
      remove_jump(session_, jump, session_.recordings[i].values);
      jumps_.push_back(jump);
    }
  }
  find_jumping_pixels(session_, bad_);
}

void Diagnosis::judge_noise() {
  noise_ = measure_noise(session_, ceiling_k_);
  // Counts cannot be compared with a profile in kelvin.
  const bool kelvin = session_.recordings.front().kelvin;
  const double nominal = kelvin ? nominal_noise(options_.profile) : noise_.white_k;
  if (!kelvin) {
    report_.warnings.push_back(
        session_.recordings.front().name +
        ": holds counts, not kelvin; figures in K are counts, and the noise's level is not judged");
  }
  floor_k_ = noise_.frames > 0 && noise_.total_k > 0.0 ? noise_.total_k : nominal;
  const bool coarse = find_step(session_) > 1.5 * std::max(options_.profile.quantisation_k, 1e-9);
  coarse_ = coarse;
  if (coarse && options_.profile.quantisation_k > 0.0) {
    // A still field sits at one place between two steps; what moves sees the whole step.
    const double step = find_step(session_);
    floor_k_ = std::max(floor_k_, std::sqrt(options_.profile.noise_k * options_.profile.noise_k + step * step / 12.0));
  }
  report_.noise_floor_k = floor_k_;
  if (noise_.frames == 0) return;
  const auto noise_effect = [&](const std::string& name, double z, std::map<std::string, Estimate> parameters,
                                const std::string& where) {
    FoundEffect e = named(name, confidence_from(z));
    e.of_noise = true;
    e.parameters = std::move(parameters);
    found(std::move(e), z, where);
  };
  if (noise_.flicker.z > 8.0 && noise_.flicker.value > 0.0015) {
    noise_effect("flicker", noise_.flicker.z, {{"sigma_k", interval(noise_.flicker.value, noise_.flicker.error)}},
                 "whole frames differ by an offset");
  }
  const bool rows = noise_.rows.z > 8.0 && noise_.rows.value > 0.0015;
  const bool columns = noise_.columns.z > 8.0 && noise_.columns.value > 0.0015;
  if (rows || columns) {
    std::map<std::string, Estimate> parameters;
    parameters["column_k"] = interval(noise_.columns.value, noise_.columns.error);
    parameters["row_k"] = interval(noise_.rows.value, noise_.rows.error);
    noise_effect("stripes", std::max(noise_.rows.z, noise_.columns.z), std::move(parameters),
                 "rows or columns differ by an offset in every frame");
  }
  if (noise_.filter != FrameFilter::kNone) {
    noise_effect("iir", noise_.alpha.z, {{"alpha", interval(noise_.alpha.value, noise_.alpha.error)}},
                 "the noise is correlated from frame to frame");
  }
  if (noise_.corner_hz.z > 5.0 && noise_.corner_hz.value > 0.08) {
    noise_effect("one_over_f", noise_.corner_hz.z,
                 {{"corner_hz", interval(noise_.corner_hz.value, noise_.corner_hz.error)}},
                 "the noise grows towards low frequencies");
  }
  const bool tails = noise_.excess_kurtosis.z > 8.0 && noise_.excess_kurtosis.value > 0.25 && !coarse;
  if (tails) {
    noise_effect("heavy_tail", noise_.excess_kurtosis.z, {{"degrees", interval(noise_.degrees, noise_.degrees_error)}},
                 "the noise has outliers");
  }
  const double scale = noise_.white_k / nominal;
  const double margin = tails ? 1.12 : 1.04;
  if (scale > margin && !coarse) {
    const double error = 0.004 * scale;
    const double white2 = noise_.white_k * noise_.white_k;
    const double q2 = options_.profile.quantisation_k * options_.profile.quantisation_k / 12.0;
    const double own = std::sqrt(std::max(0.0, white2 - q2)) / options_.profile.noise_k;
    noise_effect("noise_level", (scale - 1.0) / error, {{"scale", interval(own, error)}},
                 "the noise is stronger than the profile says");
  }
  if (noise_.line_p < 1e-6) {
    remain("readout",
           "a line at " + std::to_string(static_cast<int>(std::lround(noise_.line_hz))) +
               " Hz in the means of frames or of their halves",
           8.0);
  }
  // Neighbours that share noise: what flicker and stripes leave is taken out already.
  if (std::abs(noise_.neighbour_row_z) > 8.0) {
    remain("readout", "the noise of a pixel shows in its neighbour in the row", std::abs(noise_.neighbour_row_z));
  }
  if (std::abs(noise_.neighbour_column_z) > 8.0) {
    remain("readout", "the noise of a pixel shows in its neighbour in the column", std::abs(noise_.neighbour_column_z));
  }
  if (noise_.spectrum_misfit > 7.0 && !coarse) {
    remain("noise", "the noise's spectrum has a shape that no effect gives it", noise_.spectrum_misfit);
  }
}

// Effects that show in the values themselves.
void Diagnosis::judge_values() {
  const auto pixels = static_cast<double>(session_.good.size());
  if (!bad_.jumping.empty() && (bad_.jumping.size() > 1 || bad_.step_k > 8.0 * floor_k_)) {
    FoundEffect e = named("rts", 0.99);
    const auto count = static_cast<double>(bad_.jumping.size());
    e.parameters["fraction"] = interval(count / pixels, std::sqrt(count) / pixels);
    e.parameters["step_k"] = interval(bad_.step_k, bad_.step_k / std::sqrt(count) * 0.4);
    found(std::move(e), 10.0, "some pixels jump between two levels");
  }
  const std::size_t dead = bad_.stuck.size() + bad_.noisy.size();
  if (dead > 0) {
    FoundEffect e = named("dead_pixels", 0.999);
    const auto count = static_cast<double>(dead);
    e.parameters["fraction"] = interval(count / pixels, std::sqrt(count) / pixels);
    found(std::move(e), 10.0, "some pixels are stuck or nothing but noise");
  }
  const double step = find_step(session_);
  if (options_.profile.quantisation_k > 0.0 && step > 1.5 * options_.profile.quantisation_k &&
      session_.recordings.front().kelvin) {
    FoundEffect e = named("coarse_quantisation", 0.999);
    e.of_noise = true;
    e.parameters["step_k"] = interval(step, 0.001 * step);
    found(std::move(e), 10.0, "values are multiples of a coarser step");
  }
}

void Diagnosis::correct_jumps(const State& state) {
  std::vector<int> all(static_cast<std::size_t>(session_.grid.pixels()));
  for (std::size_t p = 0; p < all.size(); ++p) all[p] = static_cast<int>(p);
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    const Recording& r = session_.recordings[i];
    // Where frames have times of their own, what they miss by is no jump.
    if (r.kind == Kind::kUniform || !has_model(r) || state.stimuli[i].times_free) continue;
    const Series residual = r.values - predict(session_, i, state, all);
    for (Jump& jump : find_jumps(session_, i, residual, freezes_)) {
      remove_jump(session_, jump, residual);
      jumps_.push_back(jump);
    }
  }
}

Result<bool> Diagnosis::judge_means() {
  const bool any = std::ranges::any_of(session_.recordings, has_model);
  if (!any) return false;
  state_ = nominal_state(session_, options_.profile);
  const State from_files = state_;
  if (noise_.filter != FrameFilter::kNone) {
    // Known from the noise; the mean passes the same filter.
    state_.camera.response.filter = noise_.filter;
    state_.camera.response.alpha = noise_.alpha.value;
  }
  std::vector<int> good;
  for (int p = 0; p < session_.grid.pixels(); ++p) {
    if (session_.good[static_cast<std::size_t>(p)] != 0) good.push_back(p);
  }
  if (good.size() < 16) return bad_input("fewer than 16 pixels are neither dead nor jumping; nothing can be judged");
  std::vector<int> some;
  for (std::size_t i = 0; i < good.size(); i += std::max<std::size_t>(1, good.size() / 256)) some.push_back(good[i]);
  if (!progress_("finding the stimuli", 0.1)) return failed("interrupted");
  const std::vector<double> matched = register_stimuli(session_, state_, some);
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (matched[i] >= kLeastCorrelation) continue;
    report_.warnings.push_back(session_.recordings[i].name + ": does not show what its /stimulus says (" +
                               std::string(name_of(session_.recordings[i].kind)) +
                               "); used for noise and events only. Check that the right file has this name");
    session_.recordings[i].kind = Kind::kField;
    raw_.recordings[i].kind = Kind::kField;
  }
  state_.camera.clip_k = ceiling_k_;
  if (std::isfinite(state_.camera.clip_k)) {
    FoundEffect e = named("saturation", 0.999);
    e.parameters["level_k"] = interval(state_.camera.clip_k, session_.recordings.front().step);
    found(std::move(e), 20.0, "values pile up at a ceiling");
  }
  Transport transport = judge_transport(session_, state_, floor_k_, some);
  smooth_speeds(session_, state_);
  Fitter fitter(session_, floor_k_, options_.threads);
  // Levels and edges of an imperfect bench take a while.
  const auto settle = [&](FitResult from) {
    for (int round = 0; round < 4; ++round) {
      FitResult next = fitter.fit(from.state, {}, 3);
      const bool still = std::abs(next.score.gap() / from.score.gap() - 1.0) < 5e-4;
      from = std::move(next);
      if (still) break;
    }
    return from;
  };
  FitResult base = settle(fitter.fit(state_, {}, 4));
  const auto free_times = [&](bool free) {
    for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
      StimulusState& stimulus = base.state.stimuli[i];
      if (session_.recordings[i].kind != Kind::kChopper) continue;
      stimulus.times_free = free;
      stimulus.late_s = state_.stimuli[i].late_s;  // whole periods only
    }
    base = settle(fitter.fit(base.state, {}, 4));
  };
  bool jittered = is_jittered(transport);
  if (jittered) free_times(true);
  correct_jumps(base.state);
  if (!jumps_.empty()) {
    // The levels had taken up a part of the jump: once more, without it.
    base = fitter.fit(base.state, {}, 3);
    std::vector<int> all(static_cast<std::size_t>(session_.grid.pixels()));
    for (std::size_t p = 0; p < all.size(); ++p) all[p] = static_cast<int>(p);
    for (Jump& jump : jumps_) {
      const Recording& r = session_.recordings[jump.recording];
      if (r.kind != Kind::kUniform)
        remove_jump(session_, jump, r.values - predict(session_, jump.recording, base.state, all));
    }
    base = settle(fitter.fit(base.state, {}, 2));
  }
  const int repeats = [&] {
    std::size_t sum = 0;
    for (const std::size_t n : repeated_) sum += n;
    return static_cast<int>(sum);
  }();
  const int losses = transport.lost + transport.inserted + repeats;
  double frames = 0.0;
  for (const Recording& r : session_.recordings) frames += r.frames();
  if (losses > 0) {
    FoundEffect e = named("frame_loss", 0.999);
    const double rate = losses / frames * 1000.0;
    e.parameters["per_thousand"] = interval(rate, std::sqrt(static_cast<double>(losses)) / frames * 1000.0);
    found(std::move(e), 10.0, "frames are lost or repeated without a gap in the counter");
  }
  const bool may_drift = noise_.drift_p < 1e-6 && noise_.drift_k > 0.003;
  const auto may = [&](const Effect& effect) {
    if (!allowed(effect.name)) return false;
    return effect.name != "drift" || may_drift;
  };
  Selection selection = select_effects(fitter, base, may, progress_);
  judge_jitter(session_, selection.fit.state, floor_k_, some, transport);
  if (is_jittered(transport) != jittered) {
    jittered = !jittered;
    free_times(jittered);
    selection = select_effects(fitter, base, may, progress_);
    judge_jitter(session_, selection.fit.state, floor_k_, some, transport);
    jittered = jittered && is_jittered(transport);
  }
  if (jittered) {
    FoundEffect e = named("jitter", 0.99);
    e.parameters["rms_s"] = interval(transport.jitter_s, transport.jitter_error_s);
    found(std::move(e), 10.0, "the sampling time of frames varies");
  }
  // What the nominal camera leaves, with the errors of the stimuli taken out but nothing of the camera.
  nominal_ = without_transport(session_, base.state);
  nominal_.camera.response.filter = FrameFilter::kNone;
  nominal_.camera.response.alpha = 1.0;
  nominal_.camera.clip_k = std::numeric_limits<double>::infinity();
  for (StimulusState& s : nominal_.stimuli) s.times_free = false;
  const Fitter before(raw_, floor_k_, options_.threads);
  report_.gap_before = before.score(nominal_).gap();
  std::map<std::string, double> captures;
  const Score first = before.score(nominal_);
  for (std::size_t i = 0; i < raw_.recordings.size(); ++i) {
    if (has_model(raw_.recordings[i])) report_.location.captures[raw_.recordings[i].name] = first.gap_of(i);
  }
  report_.gap_after = selection.fit.score.gap();
  // Effects that were found by themselves lie between the nominal camera and the fit.
  double gap = report_.gap_before;
  for (FoundEffect& e : report_.effects) {
    if (e.of_noise) continue;
    e.gap_before = gap;
    gap = base.score.gap();
    e.gap_after = gap;
  }
  for (std::size_t c = 0; c < selection.chosen.size(); ++c) {
    const Chosen& chosen = selection.chosen[c];
    FoundEffect e = named(chosen.choice.effect->name, chosen.confidence);
    e.gap_before = chosen.gap_before;
    e.gap_after = chosen.gap_after;
    e.alternatives = chosen.alternatives;
    if (chosen.choice.effect->report) {
      e.parameters =
          chosen.choice.effect->report(session_, selection.fit.state, selection.fit.value[c], selection.fit.error[c]);
    }
    report_.effects.push_back(std::move(e));
  }
  state_ = selection.fit.state;
  if (!progress_("looking at what is left", 0.85)) return failed("interrupted");
  Allowance allowance;
  allowance.corrected.assign(session_.recordings.size(), 0);
  for (const Jump& jump : jumps_) allowance.corrected[jump.recording] = 1;
  if (noise_.corner_hz.z > 5.0) {
    // Noise slower than a capture looks fixed in it: one decade below the capture's own frequency.
    const double decade = 2.0 * noise_.corner_hz.value * session_.period_s * 2.3;
    allowance.slow_noise = 2.5;
    allowance.pattern = std::hypot(allowance.pattern, 1.5 * std::sqrt(decade) * noise_.white_k / floor_k_);
  }
  if (state_.camera.tau.size() > 0) allowance.pattern = std::max(allowance.pattern, 0.12);
  if (coarse_) allowance.pattern = 0.7;
  for (const StimulusState& stimulus : state_.stimuli)
    allowance.times_free = allowance.times_free || stimulus.times_free;
  for (const Remainder& r : test_residual(fitter, state_, allowance)) remainders_.push_back(r);
  fitted_ = true;
  fill_plots(raw_, session_, nominal_, state_, floor_k_, report_);
  // The figures beside the plots are those of the held-out cells.
  std::size_t plot = 0;
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    if (!has_model(session_.recordings[i])) continue;
    report_.captures[plot].gap_before = first.gap_of(i);
    report_.captures[plot++].gap_after = selection.fit.score.gap_of(i);
  }
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    const Recording& r = session_.recordings[i];
    if (!has_model(r)) continue;
    auto& out = report_.stimulus[r.name];
    const StimulusState& s = state_.stimuli[i];
    double worst = 0.0;
    for (std::size_t l = 0; l < s.level_k.size(); ++l) {
      const double error = s.level_k[l] - from_files.stimuli[i].level_k[l];
      if (std::abs(error) > std::abs(worst)) worst = error;
    }
    out["level_error_k"] = worst;
    if (r.kind == Kind::kChopper) {
      out["sweep_s"] = s.sweep_s;
      out["delay_s"] = s.delay_s;
      out["softness_s"] = s.softness_s;
    }
    if (r.kind == Kind::kStillBars || r.kind == Kind::kMovingBars)
      out["edge_px"] = std::sqrt(std::max(0.0, s.edge_px2));
    if (r.kind == Kind::kStillBars) out["phase_px"] = s.phase_px;
    if (r.kind == Kind::kMovingBars) {
      double mean = 0.0;
      for (const double v : s.speed_px_s) mean += v / static_cast<double>(s.speed_px_s.size());
      double scatter = 0.0;
      for (const double v : s.speed_px_s)
        scatter += (v / mean - 1.0) * (v / mean - 1.0) / static_cast<double>(s.speed_px_s.size());
      out["phase_px"] = s.shift_px.front();
      out["velocity_error"] = mean / from_files.stimuli[i].speed_px_s.front() - 1.0;
      out["velocity_unevenness"] = std::sqrt(scatter);
    }
  }
  return true;
}

void Diagnosis::conclude() {
  const double nominal = session_.recordings.front().kelvin ? nominal_noise(options_.profile) : noise_.white_k;
  for (const Effect* effect : catalogue()) {
    if (!effect->told_by(session_) && allowed(effect->name)) {
      report_.not_identifiable.push_back({effect->name, effect->needs});
    }
  }
  // Noise: by how much its variance, and its parts, differ from what is expected.
  if (noise_.frames > 0 && nominal > 0.0) {
    const auto square = [](double v) { return v * v; };
    const double measured = square(noise_.total_k);
    const double apart = std::abs(measured - square(nominal)) / square(nominal) +
                         square(noise_.flicker.value / nominal) + square(noise_.rows.value / nominal) +
                         square(noise_.columns.value / nominal);
    report_.noise_gap_before = std::sqrt(1.0 + apart);
    double left = 0.0;
    const auto has = [&](const std::string& name) {
      return std::ranges::any_of(report_.effects, [&](const FoundEffect& e) { return e.name == name; });
    };
    if (!has("flicker")) left += square(noise_.flicker.value / nominal);
    if (!has("stripes")) left += square(noise_.rows.value / nominal) + square(noise_.columns.value / nominal);
    const bool spectral =
        has("iir") || has("one_over_f") || has("noise_level") || has("heavy_tail") || has("coarse_quantisation");
    if (!spectral) left += std::abs(square(noise_.sigma_tvh) - square(nominal)) / square(nominal);
    report_.noise_gap_after = std::sqrt(1.0 + left);
    for (FoundEffect& e : report_.effects) {
      if (!e.of_noise) continue;
      e.gap_before = report_.noise_gap_before;
      e.gap_after = report_.noise_gap_after;
    }
    report_.noise = {
        {"total", "K", noise_.total_k, nominal, std::sqrt(std::max(0.0, measured - left * square(nominal)))},
        {"sigma_tvh (pixel)", "K", noise_.sigma_tvh, nominal, spectral ? noise_.sigma_tvh : nominal},
        {"sigma_t (frame)", "K", noise_.flicker.value, 0.0, has("flicker") ? noise_.flicker.value : 0.0},
        {"sigma_tv (row)", "K", noise_.rows.value, 0.0, has("stripes") ? noise_.rows.value : 0.0},
        {"sigma_th (column)", "K", noise_.columns.value, 0.0, has("stripes") ? noise_.columns.value : 0.0}};
  }
  if (!fitted_) {
    report_.gap_before = report_.noise_gap_before;
    report_.gap_after = report_.noise_gap_after;
  } else {
    // One figure: what the mean misses and what the noise's own statistics miss, in quadrature.
    const auto both = [](double mean, double noise) {
      return std::sqrt(std::max(0.0, mean * mean + noise * noise - 1.0));
    };
    report_.gap_before = both(report_.gap_before, report_.noise_gap_before);
    report_.gap_after = both(report_.gap_after, report_.noise_gap_after);
  }
  // The most telling effect first.
  std::ranges::stable_sort(report_.effects, std::greater{}, [](const FoundEffect& e) {
    return std::max(e.gap_before, 1.0) / std::max(e.gap_after, 0.5);
  });
  report_.closed_fraction =
      report_.gap_before > 1.001
          ? std::clamp((report_.gap_before - report_.gap_after) / (report_.gap_before - 1.0), 0.0, 1.0)
          : 0.0;
  std::ranges::sort(remainders_, std::greater{}, &Remainder::z);
  const double tests = std::max<double>(1.0, static_cast<double>(remainders_.size()));
  const double worst = remainders_.empty() ? 0.0 : remainders_.front().z;
  report_.unexplained.p_value = std::min(1.0, tests * std::erfc(worst / std::sqrt(2.0)));
  const bool left = worst > kRemainderLimit;
  if (left) {
    report_.unexplained.stage = remainders_.front().stage;
    report_.unexplained.where = remainders_.front().where;
  }
  if (left) {
    report_.verdict = "unknown_effect";
  } else if (report_.effects.empty()) {
    report_.verdict = "no_gap";
  } else {
    report_.verdict = report_.gap_after > 1.2 ? "partly_explained" : "explained";
  }
  report_.location.stage = report_.effects.empty() ? report_.unexplained.stage : report_.effects.front().stage;
  report_.withheld = options_.withheld;
}

Result<Report> Diagnosis::run() {
  for (const Recording& r : session_.recordings) {
    report_.inputs.push_back(r.name);
    report_.frames += r.values.rows() > 0 ? static_cast<std::size_t>(r.values.rows()) : 0U;
  }
  report_.warnings = session_.warnings;
  if (!progress_("events and pixels", 0.03)) return failed("interrupted");
  judge_events();
  if (!progress_("noise", 0.06)) return failed("interrupted");
  judge_noise();
  judge_values();
  const auto means = judge_means();
  if (!means) return tl::unexpected(means.error());
  for (const Jump& jump : jumps_) {
    FoundEffect e = named(jump.after_freeze ? "nuc_freeze" : "offset_jump", 0.99);
    static_cast<void>(jump);
    if (std::ranges::any_of(report_.effects, [&](const FoundEffect& f) { return f.name == e.name; })) continue;
    if (jump.after_freeze) continue;
    e.gap_before = report_.gap_before;
    e.gap_after = report_.gap_after;
    e.parameters["jump_k"] = interval(std::abs(jump.global_k), 0.01 * std::abs(jump.global_k) + 0.003);
    found(std::move(e), 20.0, "the offset jumps at one frame");
  }
  if (!freezes_.empty()) {
    FoundEffect e = named("nuc_freeze", 0.999);
    const Freeze& f = freezes_.front();
    e.gap_before = report_.gap_before;
    e.gap_after = report_.gap_after;
    e.parameters["freeze_frames"] = interval(static_cast<double>(f.last - f.first + 1), 1.0);
    for (const Jump& jump : jumps_) {
      if (jump.after_freeze) e.parameters["offset_k"] = interval(jump.pixel_k, 0.05 * jump.pixel_k);
    }
    found(std::move(e), 20.0, "frames are frozen for a while");
  }
  conclude();
  return report_;
}

Result<Learned> Diagnosis::learn(const std::vector<std::filesystem::path>& captures, const Report& report) const {
  const LearnTask task{session_, fitted_ ? &state_ : nullptr, jumps_, noise_.filter, report.effects, options_.profile};
  Learned learned = learn_constants(task);
  if (!options_.maps) return learned;
  if (!progress_("every pixel", 0.95)) return failed("interrupted");
  auto maps = learn_maps(task, captures, options_.threads);
  if (!maps) return tl::unexpected(maps.error());
  learned.maps = std::move(*maps);
  return learned;
}

}  // namespace

Result<Report> diagnose(const std::vector<std::filesystem::path>& captures, const Options& options,
                        const Progress& progress) {
  for (const std::string& name : options.withheld) {
    if (find_effect(name) == nullptr)
      return bad_input("--withhold " + name + ": no effect of the catalogue has this name");
  }
  const auto start = std::chrono::steady_clock::now();
  auto session = read_session(captures, progress);
  if (!session) return tl::unexpected(session.error());
  Diagnosis diagnosis(std::move(*session), options, progress);
  auto report = diagnosis.run();
  if (report) {
    auto learned = diagnosis.learn(captures, *report);
    if (!learned) return tl::unexpected(learned.error());
    report->learned = std::move(*learned);
  }
  if (report) report->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace bolo::diagnose
