// What the forward models name: from the stimuli's places in time to the effects that the mean shows.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "diagnosis.hpp"
#include "map_trend.hpp"
#include "plots.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kLeastCorrelation = 0.6;  // of a recording with its stimulus
constexpr std::size_t kLeastPixels = 16;
constexpr std::size_t kSomePixels = 256;
constexpr double kSettled = 5e-4;  // share of the gap

// A scattered part of the pixels that are neither dead nor jumping; empty when there are too few.
std::vector<int> some_pixels(const Session& session) {
  std::vector<int> good;
  for (const int p : session.grid.all()) {
    if (session.good[static_cast<std::size_t>(p)] != 0) good.push_back(p);
  }
  if (good.size() < kLeastPixels) return {};
  std::vector<int> some;
  for (std::size_t i = 0; i < good.size(); i += std::max<std::size_t>(1, good.size() / kSomePixels)) {
    some.push_back(good[i]);
  }
  return some;
}

double mean_of(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace

void Diagnosis::match_stimuli(std::span<const int> some) {
  const std::vector<double> matched = register_stimuli(session_, state_, some);
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (matched[i] >= kLeastCorrelation) continue;
    report_.warnings.push_back(session_.recordings[i].name + ": does not show what its /stimulus says (" +
                               std::string(name_of(session_.recordings[i].kind)) +
                               "); used for noise and events only. Check that the right file has this name");
    session_.recordings[i].kind = Kind::kField;
    raw_.recordings[i].kind = Kind::kField;
  }
}

void Diagnosis::judge_ceiling() {
  state_.camera.clip_k = ceiling_k_;
  if (!std::isfinite(ceiling_k_)) return;
  FoundEffect e = named("saturation", 0.999);
  e.parameters["level_k"] = interval(ceiling_k_, session_.recordings.front().step);
  found(std::move(e), 20.0, "values pile up at a ceiling");
}

void Diagnosis::correct_jumps(const State& state) {
  const std::vector<int> all = session_.grid.all();
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

// The levels had taken up a part of each jump: once more, without it.
void Diagnosis::correct_jumps_again(const State& state) {
  const std::vector<int> all = session_.grid.all();
  for (Jump& jump : jumps_) {
    const Recording& r = session_.recordings[jump.recording];
    if (r.kind == Kind::kUniform) continue;
    remove_jump(session_, jump, r.values - predict(session_, jump.recording, state, all));
  }
}

// The fit with the frames' times of choppers free, or as their files have them.
FitResult Diagnosis::with_times(const Fitter& fitter, const FitResult& base, bool free) const {
  State state = base.state;
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    if (session_.recordings[i].kind != Kind::kChopper) continue;
    state.stimuli[i].times_free = free;
    state.stimuli[i].late_s = state_.stimuli[i].late_s;  // whole periods only
  }
  return fitter.settle(fitter.fit(state, {}, 4), 3, kSettled);
}

void Diagnosis::name_losses(const Transport& transport) {
  const auto repeats = std::accumulate(repeated_.begin(), repeated_.end(), std::size_t{0});
  const int losses = transport.lost + transport.inserted + static_cast<int>(repeats);
  if (losses == 0) return;
  FoundEffect e = named("frame_loss", 0.999);
  const double per_thousand = 1000.0 / static_cast<double>(report_.frames);
  e.parameters["per_thousand"] = interval(losses * per_thousand, std::sqrt(static_cast<double>(losses)) * per_thousand);
  found(std::move(e), 10.0, "frames are lost or repeated without a gap in the counter");
}

Status Diagnosis::judge_means() {
  if (!testable()) return {};
  state_ = nominal_state(session_, options_.profile);
  if (noise_.filter != FrameFilter::kNone) {
    // Known from the noise; the mean passes the same filter.
    state_.camera.response.filter = noise_.filter;
    state_.camera.response.alpha = noise_.alpha.value;
  }
  const std::vector<int> some = some_pixels(session_);
  if (some.empty()) return bad_input("fewer than 16 pixels are neither dead nor jumping; nothing can be judged");
  if (!progress_("finding the stimuli", 0.1)) return failed("interrupted");
  match_stimuli(some);
  if (!testable()) return {};
  judge_ceiling();
  Transport transport = judge_transport(session_, state_, floor_k_, some);
  smooth_speeds(session_, state_);
  const Fitter fitter(session_, floor_k_, options_.threads);
  // Levels and edges of an imperfect bench take a while.
  FitResult base = fitter.settle(fitter.fit(state_, {}, 4), 3, kSettled);
  bool jittered = is_jittered(transport);
  if (jittered) base = with_times(fitter, base, true);
  correct_jumps(base.state);
  if (!jumps_.empty()) {
    base = fitter.fit(base.state, {}, 3);
    correct_jumps_again(base.state);
    base = fitter.settle(fitter.fit(base.state, {}, 2), 3, kSettled);
  }
  name_losses(transport);
  const auto may = [this](const Effect& effect) {
    return allowed(effect.name) && (!effect.suspected_by || effect.suspected_by(noise_));
  };
  Selection selection = select_effects(fitter, base, may, progress_);
  judge_jitter(session_, selection.fit.state, floor_k_, some, transport);
  if (is_jittered(transport) != jittered) {
    jittered = !jittered;
    base = with_times(fitter, base, jittered);
    selection = select_effects(fitter, base, may, progress_);
    judge_jitter(session_, selection.fit.state, floor_k_, some, transport);
    jittered = jittered && is_jittered(transport);
  }
  if (jittered) {
    FoundEffect e = named("jitter", 0.99);
    e.parameters["rms_s"] = interval(transport.jitter_s, transport.jitter_error_s);
    found(std::move(e), 10.0, "the sampling time of frames varies");
  }
  state_ = selection.fit.state;
  fitted_ = true;
  compare_with_nominal(base, selection);
  if (!progress_("looking at what is left", 0.85)) return failed("interrupted");
  test_what_is_left(fitter);
  say_stimulus();
  return {};
}

void Diagnosis::compare_with_nominal(const FitResult& base, const Selection& selection) {
  // What the nominal camera leaves, with the errors of the stimuli taken out but nothing of the camera.
  State nominal = without_transport(session_, base.state);
  nominal.camera.response.filter = FrameFilter::kNone;
  nominal.camera.response.alpha = 1.0;
  nominal.camera.clip_k = std::numeric_limits<double>::infinity();
  for (StimulusState& s : nominal.stimuli) s.times_free = false;
  const Score before = Fitter(raw_, floor_k_, options_.threads).score(nominal);
  const Score& after = selection.fit.score;
  report_.gap_before = before.gap();
  report_.gap_after = after.gap();
  name_chosen(base, selection);
  fill_plots(raw_, session_, nominal, state_, floor_k_, report_);
  // The figures beside the plots are those of the held-out cells.
  auto plots = report_.captures.begin();
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    if (!has_model(session_.recordings[i])) continue;
    report_.location.captures[session_.recordings[i].name] = before.gap_of(i);
    plots->gap_before = before.gap_of(i);
    (plots++)->gap_after = after.gap_of(i);
  }
}

void Diagnosis::name_chosen(const FitResult& base, const Selection& selection) {
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
}

void Diagnosis::test_what_is_left(const Fitter& fitter) {
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
  allowance.flicker = noise_.flicker.value / floor_k_;
  allowance.times_free = std::ranges::any_of(state_.stimuli, &StimulusState::times_free);
  for (Remainder& r : test_residual(fitter, state_, allowance)) remainders_.push_back(std::move(r));
  const auto test_map = [this](const Eigen::VectorXf& map, const std::string& what) {
    const double z = row_trend_z(session_, map);
    if (z < kClearTrend) return;
    const double weighed = z * kRemainderLimit / kClearTrend;
    remain("readout", "the " + what + " of pixels change smoothly from row to row", weighed);
  };
  test_map(state_.camera.offset, "offsets");
  test_map(state_.camera.gain, "gains");
}

void Diagnosis::say_stimulus() {
  const State files = nominal_state(session_, {});
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    const Recording& r = session_.recordings[i];
    if (!has_model(r)) continue;
    auto& out = report_.stimulus[r.name];
    const StimulusState& s = state_.stimuli[i];
    double worst = 0.0;
    for (std::size_t l = 0; l < s.level_k.size(); ++l) {
      const double error = s.level_k[l] - files.stimuli[i].level_k[l];
      if (std::abs(error) > std::abs(worst)) worst = error;
    }
    out["level_error_k"] = worst;
    if (r.kind == Kind::kChopper) {
      out["sweep_s"] = s.sweep_s;
      out["delay_s"] = s.delay_s;
      out["softness_s"] = s.softness_s;
    }
    if (r.kind == Kind::kStillBars || r.kind == Kind::kMovingBars) {
      out["edge_px"] = std::sqrt(std::max(0.0, s.edge_px2));
    }
    if (r.kind == Kind::kStillBars) out["phase_px"] = s.phase_px;
    if (r.kind == Kind::kMovingBars) {
      const double mean = mean_of(s.speed_px_s);
      double scatter = 0.0;
      for (const double v : s.speed_px_s) scatter += (v / mean - 1.0) * (v / mean - 1.0);
      out["phase_px"] = s.shift_px.front();
      out["velocity_error"] = mean / files.stimuli[i].speed_px_s.front() - 1.0;
      out["velocity_unevenness"] = std::sqrt(scatter / static_cast<double>(s.speed_px_s.size()));
    }
  }
}

}  // namespace bolo::diagnose
