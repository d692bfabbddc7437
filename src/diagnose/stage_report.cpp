// From all stages to the figures and the verdict of the report.
#include "src/diagnose/field.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr double kPartly = 1.2;       // largest gap left that counts as explained
constexpr double kNoGap = 1.001;      // smaller ones count as none
constexpr double kLargeStep = 8.0;    // least step of a single jumping pixel, noise floors
constexpr double kStepScatter = 0.4;  // relative scatter of the jumping pixels' steps
constexpr double kJumpError_k = 0.003;

double square(double v) { return v * v; }

template <typename T>
void append(std::vector<T>& to, const std::vector<T>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

bool has(const Report& report, std::initializer_list<std::string_view> effects) {
  return std::ranges::any_of(report.effects,
                             [&](const FoundEffect& e) { return std::ranges::count(effects, e.name) != 0; });
}

Findings judge_values(const Events& events, const Noise& noise, const Options& options) {
  Findings out;
  const Session& session = events.session;
  const BadPixels& bad = events.bad;
  // Share of `all`, with a counting error.
  const auto fraction = [](std::size_t some, double all) {
    const auto count = static_cast<double>(some);
    return interval(count / all, std::sqrt(count) / all);
  };
  if (!bad.jumping.empty() && (bad.jumping.size() > 1 || bad.step_k > kLargeStep * noise.floor_k)) {
    const double root = std::sqrt(static_cast<double>(bad.jumping.size()));
    out.add("rts", 10.0, "some pixels jump between two levels",
            {{"fraction", fraction(bad.jumping.size(), static_cast<double>(session.good.size()))},
             {"step_k", interval(bad.step_k, bad.step_k / root * kStepScatter)}},
            0.99);
  }
  if (const std::size_t dead = bad.stuck.size() + bad.noisy.size(); dead > 0) {
    const auto pixels = static_cast<double>(session.width) * static_cast<double>(session.height);
    out.add("dead_pixels", 10.0, "some pixels are stuck or nothing but noise", {{"fraction", fraction(dead, pixels)}},
            0.999);
  }
  if (events.coarse && options.profile.quantisation_k > 0.0 && session.recordings.front().kelvin) {
    const double steps =
        events.step_k / session.recordings.front().step;  // others than whole ones are rounded to these
    const double rounded = steps == std::round(steps) ? 0.0 : 0.1 * session.recordings.front().step;
    const Estimate step_k = interval(events.step_k, 0.001 * events.step_k + rounded);
    out.add("coarse_quantisation", 10.0, "values are multiples of a coarser step", {{"step_k", step_k}}, 0.999)
        .of_noise = true;
  }
  return out;
}

// Jumps and freezes, which were removed before the fits.
Findings judge_jumps(const Events& events, const std::vector<Jump>& jumps, const Report& report) {
  Findings out;
  const auto found = [&](const char* name, const char* where, Estimates parameters, double confidence) {
    out.add(name, 20.0, where, std::move(parameters), confidence).gap = report.gap;
  };
  const auto jump = std::ranges::find(jumps, false, &Jump::after_freeze);
  if (jump != jumps.end()) {
    // Signed global step, or the rms if each pixel jumps by its own amount.
    const double size = std::abs(jump->global_k) < jump->pixel_k ? jump->pixel_k : jump->global_k;
    found("offset_jump", "the offset jumps at one frame",
          {{"jump_k", interval(size, 0.01 * std::abs(size) + kJumpError_k)}}, 0.99);
  }
  // A freeze that lasts to the end is not a shutter event.
  const auto freeze = std::ranges::find_if(events.freezes, [&events](const Freeze& f) {
    return f.last + 1 < static_cast<std::size_t>(events.session.recordings[f.recording].frames());
  });
  if (freeze == events.freezes.end()) return out;
  Estimates frozen{{"freeze_frames", interval(static_cast<double>(freeze->last - freeze->first + 1), 1.0)}};
  for (const Jump& thawed : jumps) {
    if (thawed.after_freeze) frozen["offset_k"] = interval(thawed.pixel_k, 0.05 * thawed.pixel_k);
  }
  found("nuc_freeze", "frames are frozen for a while", std::move(frozen), 0.999);
  return out;
}

// Gaps of the effects, in order of selection.
void add_chosen(const Fit& fit, Report& report) {
  // Effects with statistics of their own come between the nominal camera and the fit.
  double gap = report.gap.before;
  for (FoundEffect& e : report.effects) {
    if (e.of_noise) continue;
    e.gap = {gap, fit.base.score.gap()};
    gap = e.gap.after;
  }
  const Selection& selection = fit.selection;
  for (std::size_t c = 0; c < selection.chosen.size(); ++c) {
    const Effect& effect = *selection.chosen[c].choice.effect;
    report.effects.push_back(selection.chosen[c].found);
    if (!effect.report) continue;
    report.effects.back().parameters =
        effect.report({fit.session, selection.fit.state, selection.fit.value[c], selection.fit.error[c]});
  }
}

std::map<std::string, double> stimulus_errors(const Recording& r, const State& state, const StimulusState& s,
                                              const StimulusState& file) {
  std::map<std::string, double> out;
  double worst = 0.0;
  for (std::size_t l = 0; l < s.level_k.size(); ++l) {
    const double error = s.level_k[l] - file.level_k[l];
    if (std::abs(error) > std::abs(worst)) worst = error;
  }
  out["level_error_k"] = worst;
  if (r.kind == Kind::kChopper) {
    out["sweep_s"] = s.sweep_s;
    out["delay_s"] = s.delay_s;
    out["softness_s"] = s.softness_s;
  }
  if (is_bars(r.kind)) {
    out["edge_px"] = state.edge_px;
    out["edge_ramp"] = state.edge_ramp;
    out["aperture_px"] = state.aperture_px;
  }
  const auto phase = [&r](double px) { return std::remainder(px, std::get<capture::BarTarget>(r.stimulus).period_px); };
  if (r.kind == Kind::kStillBars) out["phase_px"] = phase(s.phase_px);
  if (r.kind == Kind::kMovingBars) {
    const double mean = s.mean_speed();
    const double scatter = sum_of(s.speed_px_s, [mean](double v) { return (v / mean - 1.0) * (v / mean - 1.0); });
    out["phase_px"] = phase(s.shift_px.front());
    out["velocity_error"] = mean / file.speed_px_s.front() - 1.0;
    out["velocity_unevenness"] = std::sqrt(scatter / static_cast<double>(s.speed_px_s.size()));
  }
  return out;
}

void fill_fit(const Fit& fit, const Noise& noise, Report& report) {
  report.gap = {fit.before.gap(), fit.selection.fit.score.gap()};
  add_chosen(fit, report);
  fill_plots(fit, noise.floor_k, report);
  const State files = nominal_state(fit.session, {});
  for (const std::size_t i : modelled(fit.session)) {
    const Recording& r = fit.session.recordings[i];
    report.location.captures[r.name] = fit.before.gap(i);
    report.stimulus[r.name] = stimulus_errors(r, fit.state, fit.state.stimuli[i], files.stimuli[i]);
  }
}

// Rounding to coarse steps whitens the noise, so the filter's weight is taken from the fit of delayed edges.
void take_filter_from_edges(const Fit& fit, Report& report) {
  constexpr double kError = 0.005;
  for (FoundEffect& e : report.effects) {
    if (e.name == "iir") e.parameters["alpha"] = interval(fit.state.camera.response.alpha, kError);
  }
}

// Gap of the noise: deviations of its variance and components from the nominal ones.
void fill_noise(const Noise& noise, Report& report) {
  const NoiseStatistics& n = noise.statistics;
  const double nominal = noise.nominal_k;
  report.noise_floor_k = noise.floor_k;
  if (n.frames == 0 || nominal <= 0.0) return;
  const auto share = [nominal](double sigma) { return square(sigma / nominal); };
  const double stripes = share(n.rows.value) + share(n.columns.value);
  report.noise_gap.before = std::sqrt(1.0 + std::abs(share(n.total_k) - 1.0) + share(n.flicker.value) + stripes);
  const bool flicker = has(report, {"flicker"});
  const bool striped = has(report, {"stripes"});
  const bool spectral = has(report, {"iir", "one_over_f", "noise_level", "heavy_tail", "coarse_quantisation"});
  double left = flicker ? 0.0 : share(n.flicker.value);
  if (!striped) left += stripes;
  if (!spectral) left += std::abs(share(n.sigma_tvh) - 1.0);
  report.noise_gap.after = std::sqrt(1.0 + left);
  for (FoundEffect& e : report.effects) {
    if (e.of_noise) e.gap = report.noise_gap;
  }
  const double explained = std::sqrt(std::max(0.0, square(n.total_k) - left * square(nominal)));
  report.noise = {{"total", n.total_k, nominal, explained},
                  {"sigma_tvh (pixel)", n.sigma_tvh, nominal, spectral ? n.sigma_tvh : nominal},
                  {"sigma_t (frame)", n.flicker.value, 0.0, flicker ? n.flicker.value : 0.0},
                  {"sigma_tv (row)", n.rows.value, 0.0, striped ? n.rows.value : 0.0},
                  {"sigma_th (column)", n.columns.value, 0.0, striped ? n.columns.value : 0.0}};
}

// Combines the gaps of mean and noise in quadrature.
void join_gaps(bool fitted, Report& report) {
  const auto both = [fitted](double mean, double noise) {
    return fitted ? std::sqrt(std::max(0.0, mean * mean + noise * noise - 1.0)) : noise;
  };
  report.gap.before = both(report.gap.before, report.noise_gap.before);
  report.gap.after = both(report.gap.after, report.noise_gap.after);
  std::ranges::stable_sort(report.effects, std::greater{}, [](const FoundEffect& e) {
    return std::max(e.gap.before, 1.0) / std::max(e.gap.after, 0.5);
  });
  if (report.gap.before <= kNoGap) return;
  report.closed_fraction = std::clamp((report.gap.before - report.gap.after) / (report.gap.before - 1.0), 0.0, 1.0);
}

void judge(std::vector<Remainder> left, Report& report) {
  std::ranges::sort(left, std::greater{}, &Remainder::z);
  const double tests = std::max(1.0, static_cast<double>(left.size()));
  const double worst = left.empty() ? 0.0 : left.front().z;
  report.unexplained.p_value = std::min(1.0, tests * std::erfc(worst / std::sqrt(2.0)));
  if (worst > kRemainderLimit) {
    const Remainder& first = left.front();
    report.unexplained.stage = first.misfit ? stage_of_misfits(left) : first.stage;
    report.unexplained.where = first.where;
    report.verdict = "unknown_effect";
  } else if (report.effects.empty()) {
    report.verdict = "no_gap";
  } else {
    report.verdict = report.gap.after > kPartly ? "partly_explained" : "explained";
  }
  report.location.stage = report.effects.empty() ? report.unexplained.stage : report.effects.front().stage;
}

// True if the levels deviate by more than those of an accurate bench.
bool levels_scatter(const Fit& fit) {
  constexpr double kOff_k = 0.02;
  const State files = nominal_state(fit.session, {});
  return level_error(nuisances(fit.session, files), fit.state) > kOff_k;
}

// Without a prediction gaps are NaN, and `needs` names captures that would test the simulator.
void mark_not_testable(const Session& session, const Noise& noise, const std::string& why, Report& report) {
  report.verdict = "not_testable";
  report.needs =
      "captures of a known stimulus: a closed shutter or a flat black body for noise and offsets, a chopper or a pan "
      "over bars for the time constant";
  report.needs += (session.recordings.front().kelvin ? "" : "; in kelvin, not in counts") + why;
  report.gap.before = report.gap.after = report.closed_fraction = kUnknown;
  if (noise.statistics.frames == 0) {
    report.noise_gap.before = report.noise_gap.after = report.noise_floor_k = kUnknown;
  }
  for (FoundEffect& e : report.effects) {
    if (!e.of_noise) e.gap.before = e.gap.after = kUnknown;
  }
}

// With a wrong description of the bench, no effects of the camera are reported.
void mark_wrong_description(const std::vector<std::string>& wrong, Report& report) {
  report.verdict = "bench_description";
  report.effects.clear();
  report.needs = "/stimulus says otherwise than the pictures show: ";
  for (const std::string& one : wrong) report.needs += (&one == wrong.data() ? "" : "; ") + one;
  report.unexplained = {0.0, {}, report.needs};
  report.location.stage.clear();
  report.gap.before = report.gap.after = report.closed_fraction = kUnknown;
}

std::vector<PixelPlace> places_of(const std::vector<int>& pixels, int width) {
  return mapped(pixels, [width](int pixel) { return place_of(static_cast<std::size_t>(pixel), width); });
}

}  // namespace

const FoundEffect* LearnTask::found(std::string_view name) const {
  const auto at = std::ranges::find(effects, name, &FoundEffect::name);
  return at == effects.end() ? nullptr : &*at;
}

FoundEffect& Findings::add(const std::string& name, double z, const std::string& where, Estimates parameters,
                           std::optional<double> confidence) {
  const double by_z = 1.0 - 0.5 * std::erfc(std::min(z, 6.0) / 2.0);
  effects.push_back({named(name, confidence.value_or(by_z), std::move(parameters)), z, where});
  return effects.back().effect;
}

FoundEffect named(const std::string& name, double confidence, Estimates parameters) {
  return {.name = name,
          .stage = find_effect(name)->stage,
          .confidence = confidence,
          .parameters = std::move(parameters),
          .alternatives = {}};
}

bool allowed(const Options& options, const std::string& name) {
  return std::ranges::count(options.withheld, name) == 0;
}

Report make_report(const Events& events, const Noise& noise, const Fit& fit, const Field& field,
                   const std::vector<Remainder>& left, const Options& options) {
  const Session& session = fit.session;
  Report report;
  for (const Recording& r : session.recordings) {
    report.inputs.push_back(r.name);
    report.frames += static_cast<std::size_t>(r.frames());
  }
  std::vector<Remainder> all;
  const auto take = [&](const Findings& findings) {
    for (const Finding& one : findings.effects) {
      if (allowed(options, one.effect.name)) {
        report.effects.push_back(one.effect);
      } else {
        all.push_back({one.effect.stage, one.where, one.z});
      }
    }
    append(all, findings.remainders);
  };
  take(noise.findings);
  take(judge_values(events, noise, options));
  take(fit.findings);
  take(field.findings);
  if (fit.done) fill_fit(fit, noise, report);
  if (fit.done && events.coarse) take_filter_from_edges(fit, report);
  if (field.judged) {
    report.gap = field.gap;
    report.location.captures = field.gaps;
  }
  report.scene = field.scene;
  append(all, left);
  take(judge_jumps(events, fit.done ? fit.jumps : events.jumps, report));  // a fit with a bench finds more
  for (const auto* warnings : {&session.warnings, &events.warnings, &noise.findings.warnings, &fit.findings.warnings}) {
    append(report.warnings, *warnings);
  }
  const bool kelvin = session.recordings.front().kelvin;
  for (const Effect& effect : catalogue()) {
    const bool told = effect.testable_in(session) || field.tells(effect);
    const bool compared = kelvin || (effect.name != "noise_level" && effect.name != "coarse_quantisation");
    if (!(told && compared) && allowed(options, effect.name)) {
      report.not_identifiable.push_back({effect.name, told ? "values in kelvin, as the profile's" : effect.needs});
    }
  }
  // A small reflection is confounded with level errors of the bench.
  if (fit.done && allowed(options, "emissivity") && levels_scatter(fit) &&
      std::ranges::none_of(fit.selection.chosen,
                           [](const Chosen& c) { return c.choice.effect->name == "emissivity"; })) {
    report.not_identifiable.push_back({"emissivity", "black bodies whose temperatures are known better than these"});
  }
  report.kelvin = kelvin;
  fill_noise(noise, report);
  join_gaps(fit.done || field.judged, report);
  judge(std::move(all), report);
  report.defects = {places_of(events.bad.stuck, session.width), places_of(events.bad.noisy, session.width)};
  for (const Recording& r : session.recordings) {
    const auto seen = field.seen.find(r.name);
    if (!has_model(r)) report.observations.push_back(seen == field.seen.end() ? observe(r) : seen->second);
  }
  if (!field.judged && !has_bench(session)) mark_not_testable(session, noise, field.why, report);
  if (!fit.wrong_description.empty()) mark_wrong_description(fit.wrong_description, report);
  report.withheld = options.withheld;
  return report;
}

}  // namespace bolo::diagnose
