// From events and noise to the fit: registration of the stimuli, transport, and effects on the mean.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kLeastMatch = 0.6;  // of a recording with its stimulus
constexpr std::size_t kLeastPixels = 16;
constexpr std::size_t kSomePixels = 256;
constexpr double kFirstSettled = 5e-4;  // convergence: change of the gap, relative
constexpr int kFirstRounds = 4;         // of the first fit: levels and edges of an imperfect bench converge slowly
constexpr double kLeastJumpOfJittered_k = 0.08;
constexpr int kMoreRounds = 3;  // per step until convergence

// A scattered subset of the good pixels; empty when there are too few.
std::vector<int> some_pixels(const Session& session) {
  const std::vector<int> good = session.good_pixels();
  std::vector<int> some;
  for (std::size_t i = 0; i < good.size(); i += std::max<std::size_t>(1, good.size() / kSomePixels)) {
    some.push_back(good[i]);
  }
  return good.size() < kLeastPixels ? std::vector<int>{} : some;
}

// Registers the stimuli; a recording that does not match its stimulus becomes a field recording.
void match_stimuli(std::span<const int> some, Fit& fit) {
  const std::vector<double> matched = register_stimuli(fit.session, fit.state, some);
  fit.wrong_description = doubt_description(fit.session, fit.state, some);
  if (!fit.wrong_description.empty()) return;
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (matched[i] >= kLeastMatch) continue;
    Recording& r = fit.session.recordings[i];
    fit.findings.warnings.push_back(r.name + ": does not show what its /stimulus says (" +
                                    std::string(name_of(r.kind)) +
                                    "); used for noise and events only. Check that the right file has this name");
    r.kind = fit.raw.recordings[i].kind = Kind::kField;
  }
}

void correct_jumps(const std::vector<Freeze>& freezes, bool jittered, const State& state, Fit& fit) {
  const std::vector<int> all = fit.session.grid.all();
  for (const std::size_t i : modelled(fit.session)) {
    const Recording& r = fit.session.recordings[i];
    // With free frame times, residuals are not due to jumps.
    if (r.kind == Kind::kUniform || state.stimuli[i].times_free) continue;
    if (std::ranges::count(fit.jumps, i, &Jump::recording) > 0) continue;
    const Series predicted = predict(fit.session, i, state, all);
    const Series residual = r.values - predicted;
    const MatrixXd levels = level_slopes(fit.session, i, state, fit.session.good_pixels());
    const VectorXd shown = predicted.rowwise().mean().cast<double>();
    if (auto jump = find_jump(fit.session, i, residual, freezes, levels, shown)) {
      // Jitter makes the speed of a pan less certain.
      if (jittered && std::abs(jump->global_k) < kLeastJumpOfJittered_k) continue;
      remove_jump(fit.session, *jump, residual, levels);
      fit.jumps.push_back(*jump);
    }
  }
}

FitResult settled(const FitData& data, const State& start, int rounds) {
  return settle(data, fit(data, start, {}, rounds), kMoreRounds, kFirstSettled);
}

// Fits again with the choppers' frame times either free or as registered, in whole periods.
FitResult with_times(const FitData& data, const FitResult& base, const State& registered, bool free) {
  State state = base.state;
  for (std::size_t i = 0; i < data.session.recordings.size(); ++i) {
    if (data.session.recordings[i].kind != Kind::kChopper) continue;
    state.stimuli[i].times_free = free;
    state.stimuli[i].late_s = registered.stimuli[i].late_s;
  }
  return settled(data, state, kFirstRounds);
}

// Reports frames lost or repeated without a gap in the counter.
void judge_losses(const Transport& transport, const Events& events, Fit& out) {
  const auto repeats = std::accumulate(events.repeated.begin(), events.repeated.end(), std::size_t{0});
  const int losses = transport.lost + transport.inserted + static_cast<int>(repeats);
  if (losses == 0) return;
  const double per_thousand = 1000.0 / sum_of(out.session.recordings, &Recording::frames);
  const double error = std::sqrt(static_cast<double>(losses));
  out.findings.add("frame_loss", 10.0, "frames are lost or repeated without a gap in the counter",
                   {{"per_thousand", interval(losses * per_thousand, error * per_thousand)}}, 0.999);
}

// Removes the jumps that the fit reveals, and fits again.
FitResult without_jumps(const FitData& data, const Events& events, bool jittered, FitResult base, Fit& out) {
  correct_jumps(events.freezes, jittered, base.state, out);
  if (out.jumps.empty()) return base;
  return settled(data, base.state, kMoreRounds);
}

// Fits the stimuli alone: removes jumps, and frees frame times if these are jittered.
FitResult fit_stimuli(const FitData& data, const Events& events, bool jittered, Fit& out) {
  FitResult base = settled(data, out.state, kFirstRounds);
  if (jittered) base = with_times(data, base, out.state, true);
  return without_jumps(data, events, jittered, std::move(base), out);
}

// The nominal camera with the fitted stimulus errors.
State nominal_camera(const Session& session, const State& base) {
  State nominal = without_transport(session, base);
  nominal.camera.response.filter = FrameFilter::kNone;
  nominal.camera.response.alpha = 1.0;
  nominal.camera.clip_k = std::numeric_limits<double>::infinity();
  for (StimulusState& s : nominal.stimuli) s.times_free = false;
  return nominal;
}

}  // namespace

Result<Fit> fit_means(const Events& events, const Noise& noise, const Options& options, const Progress& progress) {
  Fit out;
  out.session = events.session;
  out.raw = events.raw;
  out.jumps = events.jumps;
  if (!has_bench(out.session)) return out;
  out.state = nominal_state(out.session, options.profile);
  if (noise.statistics.filter != FrameFilter::kNone) {
    // Known from the noise; the mean passes through the same filter.
    out.state.camera.response.filter = noise.statistics.filter;
    out.state.camera.response.alpha = noise.statistics.alpha.value;
  }
  const std::vector<int> some = some_pixels(out.session);
  if (some.empty()) return bad_input("fewer than 16 pixels are neither dead nor jumping; nothing can be judged");
  if (!progress("finding the stimuli", 0.1)) return failed("interrupted");
  match_stimuli(some, out);
  if (!has_bench(out.session) || !out.wrong_description.empty()) return out;
  out.state.camera.clip_k = events.ceiling_k;
  if (std::isfinite(events.ceiling_k)) {
    out.findings.add("saturation", 20.0, "values pile up at a ceiling",
                     {{"level_k", interval(events.ceiling_k, out.session.recordings.front().step)}}, 0.999);
  }
  Transport transport = judge_transport(out.session, out.state, noise.floor_k, some);
  smooth_speeds(out.session, out.state);
  const FitData data(out.session, noise.floor_k, options.threads);
  bool jittered = is_jittered(transport);
  out.base = fit_stimuli(data, events, jittered, out);
  judge_losses(transport, events, out);
  const auto may = [&](const Effect& effect) {
    return allowed(options, effect.name) && (!effect.suspected_by || effect.suspected_by(noise.statistics));
  };
  out.selection = select_effects(data, out.base, may, progress);
  const auto judge_again = [&] {
    double miss = 1.0;  // misfit of the pans, in floors: model errors scatter the shifts as noise does
    for (const std::size_t i : modelled(out.session)) {
      if (out.session.recordings[i].kind == Kind::kMovingBars) miss = std::max(miss, out.selection.fit.score.gap(i));
    }
    judge_jitter(out.session, out.selection.fit.state, miss * noise.floor_k, some, transport);
  };
  judge_again();
  if (is_jittered(transport) != jittered) {
    jittered = !jittered;
    // Choppers are not searched for jumps while their frame times are free.
    out.base = without_jumps(data, events, jittered, with_times(data, out.base, out.state, jittered), out);
    out.selection = select_effects(data, out.base, may, progress);
    judge_again();
    jittered = jittered && is_jittered(transport);
  }
  if (jittered) {
    out.findings.add("jitter", 10.0, "the sampling time of frames varies",
                     {{"rms_s", interval(transport.jitter_s, transport.jitter_error_s)}}, 0.99);
  }
  out.state = out.selection.fit.state;
  out.nominal = nominal_camera(out.session, out.base.state);
  out.before = FitData(out.raw, noise.floor_k, options.threads).score(out.nominal);
  out.done = true;
  return out;
}

}  // namespace bolo::diagnose
