// Runs all stages and derives the profile of the whole camera.
#include "src/diagnose/diagnose.hpp"

#include <malloc.h>

#include <chrono>

#include "src/capture/pixel_maps_io.hpp"
#include "src/diagnose/field.hpp"

namespace bolo::diagnose {
namespace {

// The value of a parameter of an effect that was found, if both exist.
std::optional<double> parameter_of(const LearnTask& task, std::string_view effect, const std::string& key) {
  const FoundEffect* found = task.found(effect);
  if (found == nullptr) return std::nullopt;
  if (key.empty()) return 1.0;  // the effect exists
  return found->parameters.contains(key) ? std::optional(found->parameters.at(key).value) : std::nullopt;
}

double value_of(const LearnTask& task, const char* effect, const char* key, double otherwise) {
  return parameter_of(task, effect, key).value_or(otherwise);
}

struct Grey {
  double emissivity = 1.0;
  double reflected_k = kSurroundings;
};

double reflected_temperature(double signal) { return std::clamp(band_temperature(signal), 150.0, 600.0); }

// From the fit, whose radiances are relative to that of kSurroundings.
Grey grey_of(const CameraModel& camera) {
  constexpr double kLeastReflected = 1e-3;
  Grey grey{std::clamp(1.0 - camera.reflected, 0.3, 1.0)};
  if (camera.reflected >= kLeastReflected) {
    grey.reflected_k = reflected_temperature(band_signal(kSurroundings) + camera.surroundings / camera.reflected);
  }
  return grey;
}

// Regression of all fitted stimulus levels on the stated ones. Errors of a bench are independent between levels, so if
// all levels lie on the line of a grey body (fitted radiance = e * stated radiance + rest), significantly against their
// scatter, the free levels have absorbed the emissivity.
std::optional<Grey> grey_of_levels(const LearnTask& task) {
  constexpr double kLeastLevels = 6.0;
  constexpr double kLeastT = 8.0;            // Student's t of the slope
  constexpr double kLeastReflected = 0.012;  // a bench may reflect 1 %
  const State files = nominal_state(task.session, task.profile);
  Line line;  // of radiances, relative to kReference
  for (const std::size_t i : modelled(task.session)) {
    const auto& stated = files.stimuli[i].level_k;
    const auto& seen = task.state->stimuli[i].level_k;
    for (std::size_t l = 0; l < std::min(stated.size(), seen.size()); ++l) {
      line.add(band_signal(stated[l]) - kReference, band_signal(seen[l]) - kReference);
    }
  }
  if (line.count() < kLeastLevels || line.scatter_x() <= 0.0) return std::nullopt;
  const double slope = line.slope();
  const double left = std::max(0.0, line.scatter_y() - slope * line.scatter_xy()) / (line.count() - 2.0);
  const double reflected = 1.0 - slope;
  const double least = std::max(kLeastReflected, kLeastT * std::sqrt(left / line.scatter_x()));
  if (reflected < least || reflected > 0.7) return std::nullopt;
  return Grey{slope, reflected_temperature(kReference + line.level(slope) / reflected)};
}

void learn_undo(const LearnTask& task, model::Undo& undo) {
  model::undo_effects(undo, [&task](auto effect, auto key) { return parameter_of(task, effect, std::string(key)); });
  if (task.found("iir") != nullptr) {
    const double weight = value_of(task, "iir", "alpha", 1.0);
    const bool undone = task.filter != FrameFilter::kBox || weight > 0.5;
    undo.filter = undone ? task.filter : FrameFilter::kNone;
    if (undone) undo.filter_weight = std::clamp(weight, 0.05, 1.0);
  }
  if (task.state == nullptr) return;
  const CameraModel& camera = task.state->camera;
  if (const auto grey = task.found("emissivity") != nullptr ? grey_of(camera) : grey_of_levels(task)) {
    undo.emissivity = grey->emissivity;
    undo.reflected_k = grey->reflected_k;
  }
  if (task.found("radiometric_nonlinearity") != nullptr) undo.radiance = camera.radiance > 0.5;
}

// Converts maps of frames corrected by `known` to maps of uncorrected frames. Dead pixels are the same in both.
void follow(const model::PixelMaps& known, model::PixelMaps& maps) {
  const std::size_t pixels = std::max(known.gain.size(), known.offset.size());
  if (pixels > 0 && maps.offset.empty()) maps.offset.assign(pixels, 0.0F);
  if (!known.gain.empty() && maps.gain.empty()) maps.gain.assign(pixels, 1.0F);
  for (std::size_t p = 0; p < pixels; ++p) {
    const float gain = maps.gain.empty() ? 1.0F : maps.gain[p];
    if (!known.offset.empty()) maps.offset[p] += gain * known.offset[p];
    if (!known.gain.empty()) maps.gain[p] = gain * known.gain[p];
  }
  if (maps.tau_s.empty()) maps.tau_s = known.tau_s;
}

Result<Learned> learn(const LearnTask& task, const Options& options, const Progress& progress) {
  Learned learned{task.profile, {}};
  model::CameraProfile& profile = learned.profile;
  profile.tau_s *= value_of(task, "tau_global", "scale", 1.0);
  profile.noise_k *= value_of(task, "noise_level", "scale", 1.0);
  profile.frame_period_s *= 1.0 + value_of(task, "clock_skew", "skew", 0.0);
  profile.row_delay_s = value_of(task, "row_delay", "row_delay_s", profile.row_delay_s);
  profile.quantisation_k = value_of(task, "coarse_quantisation", "step_k", profile.quantisation_k);
  learn_undo(task, profile.undo);
  if (options.maps) {
    if (!progress("every pixel", 0.95)) return failed("interrupted");
    ASSIGN_OR_RETURN(learned.maps, learn_maps(task, options.threads));
  }
  follow(task.session.known, learned.maps);
  learned.maps.row_delay_s = profile.row_delay_s;
  return learned;
}

// The fits make and drop predictions of a megabyte all the time. glibc would return each to the system, whose new pages
// take a quarter of a diagnosis.
void keep_freed_memory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
}

}  // namespace

Result<Report> diagnose(const std::vector<std::filesystem::path>& captures, const Options& options,
                        const Progress& progress) {
  for (const std::string& name : options.withheld) {
    if (find_effect(name) == nullptr)
      return bad_input("--withhold " + name + ": no effect of the catalogue has this name");
  }
  keep_freed_memory();
  const auto start = std::chrono::steady_clock::now();
  ASSIGN_OR_RETURN(auto known, capture::read_profile_maps(options.profile));
  ASSIGN_OR_RETURN(auto session, read_session(captures, progress, std::move(known)));
  if (!progress("events and pixels", 0.03)) return failed("interrupted");
  Events events = find_events(std::move(session), options);
  prepare_field(events);
  if (!progress("noise", 0.06)) return failed("interrupted");
  const Noise noise = judge_noise(events, options);
  ASSIGN_OR_RETURN(const auto fit, fit_means(events, noise, options, progress));
  std::vector<Remainder> left;
  if (fit.done) {
    if (!progress("looking at what is left", 0.85)) return failed("interrupted");
    left = test_remainder(events, noise, fit, options.threads);
  }
  ASSIGN_OR_RETURN(const auto field, judge_field(events, noise, options, progress));
  Report report = make_report(events, noise, fit, field, left, options);
  if (options.profile.undo != model::Undo{} || !events.session.known.tau_s.empty()) {
    report.warnings.emplace_back(
        "of the profile's corrections only gains, offsets and dead pixels were applied before; what the others undo is "
        "named again");
  }
  ASSIGN_OR_RETURN(report.learned, learn({fit.session, fit.done ? &fit.state : nullptr, fit.jumps, events.bad,
                                          noise.statistics.filter, field.maps, report.effects, options.profile},
                                         options, progress));
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace bolo::diagnose
