#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "src/diagnose/learn.hpp"
#include "src/diagnose/response.hpp"

namespace bolo::diagnose {
namespace {

// The value of a found effect's parameter; nothing where either is not there.
std::optional<double> parameter_of(const LearnTask& task, std::string_view effect, std::string_view key) {
  const FoundEffect* found = task.found(effect);
  if (found == nullptr) return std::nullopt;
  if (key.empty()) return 1.0;  // that there is one
  const auto parameter = found->parameters.find(std::string(key));
  return parameter == found->parameters.end() ? std::nullopt : std::optional(parameter->second.value);
}

double value_of(const LearnTask& task, const char* effect, const char* key, double otherwise) {
  return parameter_of(task, effect, key).value_or(otherwise);
}

// Temperature of what is reflected: the model has the radiance reflected beyond that of kSurroundings.
double reflected_temperature(const CameraModel& camera) {
  constexpr double kLeastReflected = 1e-3;
  if (camera.reflected < kLeastReflected) return kSurroundings;
  const double signal = band_signal(kSurroundings) + camera.surroundings / camera.reflected;
  return std::clamp(band_temperature(signal), 150.0, 600.0);
}

model::FrameFilter filter_of(FrameFilter filter) {
  if (filter == FrameFilter::kBox) return model::FrameFilter::kBox;
  return filter == FrameFilter::kRecursive ? model::FrameFilter::kRecursive : model::FrameFilter::kNone;
}

// A grey body: emissivity and what it reflects.
struct Grey {
  double emissivity = 1.0;
  double reflected_k = kSurroundings;
};

// The levels of all stimuli as they were fitted against those of their files. A bench errs in each level by itself;
// when all lie on the line of a grey body (radiance seen = e radiance stated + rest), far beyond their scatter about
// it, it is the emissivity, which the fit had left to the levels.
std::optional<Grey> grey_of_levels(const LearnTask& task) {
  constexpr std::size_t kLeastLevels = 6;
  constexpr double kLeastT = 8.0;            // of Student's t of the slope
  constexpr double kLeastReflected = 0.012;  // a bench may reflect a hundredth
  const State files = nominal_state(task.session, task.profile);
  std::vector<std::pair<double, double>> levels;  // stated, seen
  for (std::size_t i = 0; i < files.stimuli.size(); ++i) {
    const auto& stated = files.stimuli[i].level_k;
    const auto& seen = task.state->stimuli[i].level_k;
    if (!has_model(task.session.recordings[i])) continue;
    for (std::size_t l = 0; l < std::min(stated.size(), seen.size()); ++l) {
      levels.emplace_back(band_signal(stated[l]), band_signal(seen[l]));
    }
  }
  const auto n = static_cast<double>(levels.size());
  if (levels.size() < kLeastLevels) return std::nullopt;
  double x = 0.0;
  double y = 0.0;
  for (const auto& [stated, seen] : levels) {
    x += stated / n;
    y += seen / n;
  }
  double xx = 0.0;
  double xy = 0.0;
  for (const auto& [stated, seen] : levels) {
    xx += (stated - x) * (stated - x);
    xy += (stated - x) * (seen - y);
  }
  if (xx <= 0.0) return std::nullopt;
  const double slope = xy / xx;
  double left = 0.0;
  for (const auto& [stated, seen] : levels) left += std::pow(seen - y - slope * (stated - x), 2) / (n - 2.0);
  const double reflected = 1.0 - slope;
  if (reflected < kLeastReflected || reflected > 0.7 || reflected < kLeastT * std::sqrt(left / xx)) return std::nullopt;
  return Grey{slope, std::clamp(band_temperature((y - slope * x) / reflected), 150.0, 600.0)};
}

void learn_undo(const LearnTask& task, model::Undo& undo) {
  model::undo_effects(
      undo, [&task](std::string_view effect, std::string_view key) { return parameter_of(task, effect, key); });
  if (task.found("iir") != nullptr) {
    const double weight = value_of(task, "iir", "alpha", 1.0);
    const bool undone = task.filter != FrameFilter::kBox || weight > 0.5;
    undo.filter = undone ? filter_of(task.filter) : model::FrameFilter::kNone;
    if (undone) undo.filter_weight = std::clamp(weight, 0.05, 1.0);
  }
  if (task.state == nullptr) return;
  const CameraModel& camera = task.state->camera;
  if (task.found("emissivity") != nullptr) {
    undo.emissivity = std::clamp(1.0 - camera.reflected, 0.3, 1.0);
    undo.reflected_k = reflected_temperature(camera);
  } else if (const auto grey = grey_of_levels(task)) {
    undo.emissivity = grey->emissivity;
    undo.reflected_k = grey->reflected_k;
  }
  if (task.found("radiometric_nonlinearity") != nullptr) undo.radiance = camera.radiance > 0.5;
}

}  // namespace

const FoundEffect* LearnTask::found(std::string_view name) const {
  const auto at = std::ranges::find(effects, name, &FoundEffect::name);
  return at == effects.end() ? nullptr : &*at;
}

Result<Learned> learn(const LearnTask& task, const std::vector<std::filesystem::path>& captures, const Options& options,
                      const Progress& progress) {
  Learned learned{task.profile, {}};
  model::CameraProfile& profile = learned.profile;
  profile.tau_s *= value_of(task, "tau_global", "scale", 1.0);
  profile.noise_k *= value_of(task, "noise_level", "scale", 1.0);
  profile.frame_period_s *= 1.0 + value_of(task, "clock_skew", "skew", 0.0);
  profile.row_delay_s = value_of(task, "row_delay", "row_delay_s", profile.row_delay_s);
  profile.quantisation_k = value_of(task, "coarse_quantisation", "step_k", profile.quantisation_k);
  learn_undo(task, profile.undo);
  learned.maps.row_delay_s = profile.row_delay_s;
  if (!options.maps) return learned;
  if (!progress("every pixel", 0.95)) return failed("interrupted");
  auto maps = learn_maps(task, captures, options.threads);
  if (!maps) return tl::unexpected(maps.error());
  learned.maps = std::move(*maps);
  return learned;
}

}  // namespace bolo::diagnose
