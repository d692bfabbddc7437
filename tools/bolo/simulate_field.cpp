#include "tools/bolo/simulate_field.hpp"

#include <algorithm>
#include <array>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

namespace bolo::tools {
namespace {

using Field = std::unique_ptr<const sim::Field>;
using Options = cxxopts::ParseResult;

enum StimulusKind : unsigned { kUniform = 1, kChopper = 2, kBars = 4, kScene = 8 };

struct StimulusName {
  std::string_view name;
  StimulusKind kind;
};
constexpr std::array<StimulusName, 4> kStimuli{
    {{"uniform", kUniform}, {"chopper", kChopper}, {"bar_target", kBars}, {"scene", kScene}}};

// Which stimuli an option has a meaning for.
struct OptionUse {
  const char* option;
  unsigned stimuli;
};
constexpr std::array<OptionUse, 14> kUses{{{"scene", kBars | kScene},
                                           {"speed", kBars | kScene},
                                           {"trajectory", kScene},
                                           {"trajectory-scale", kScene},
                                           {"trajectory-start", kScene},
                                           {"origin", kScene},
                                           {"cold", kChopper | kBars | kScene},
                                           {"hot", kBars | kScene},
                                           {"temperature", kUniform},
                                           {"levels", kChopper},
                                           {"pulses", kChopper},
                                           {"gap", kChopper},
                                           {"period", kBars},
                                           {"slant", kBars}}};

// The stimulus that --stimulus and --scene ask for together; every option given must have a meaning for it.
Result<StimulusKind> stimulus_kind(const Options& given) {
  const bool bars = given["scene"].as<std::string>() == "bars";
  StimulusName chosen = bars ? kStimuli[2] : kStimuli[3];
  if (given.count("stimulus") != 0) {
    const auto name = given["stimulus"].as<std::string>();
    const auto* const found = std::ranges::find(kStimuli, name, &StimulusName::name);
    if (found == kStimuli.end()) {
      return bad_input("--stimulus " + name + ": expected uniform, chopper, bar_target or scene");
    }
    chosen = *found;
  }
  for (const OptionUse& use : kUses) {
    if (given.count(use.option) != 0 && (use.stimuli & chosen.kind) == 0) {
      return bad_input("--" + std::string(use.option) + " has no meaning with the stimulus " +
                       std::string(chosen.name) + "; leave it out");
    }
  }
  if (given.count("scene") != 0 && bars != (chosen.kind == kBars)) {
    return bad_input("--scene " + given["scene"].as<std::string>() + " contradicts --stimulus " +
                     std::string(chosen.name) + "; 'bars' and 'bar_target' go together");
  }
  return chosen.kind;
}

Result<double> ranged(const Options& given, const std::string& option, double low, double high) {
  const double value = given[option].as<double>();
  if (value >= low && value <= high) return value;
  std::ostringstream message;
  message << "--" << option << ' ' << value << ": expected " << low << " to " << high;
  return bad_input(message.str());
}

Result<double> kelvin(const Options& given, const std::string& option, double fallback = 0.0) {
  if (given.count(option) == 0 && fallback > 0.0) return fallback;
  return ranged(given, option, 1.0, 2000.0);
}

Result<Field> uniform_field(const Options& given) {
  return kelvin(given, "temperature").map([](double k) { return sim::make_uniform(k); });
}

// Every length at every height, over and over, as many as end within the capture. The default gap is no multiple of a
// frame, so that the pulses begin at many phases of it.
Result<Field> chopper_field(const Options& given, double duration_s) {
  const Result<double> cold = kelvin(given, "cold", 295.0);
  if (!cold) return tl::unexpected(cold.error());
  const Result<double> gap_ms = ranged(given, "gap", 0.1, 1e6);
  if (!gap_ms) return tl::unexpected(gap_ms.error());
  const auto levels = given["levels"].as<std::vector<double>>();
  const auto pulses = given["pulses"].as<std::vector<double>>();
  for (const double level : levels) {
    if (!(level >= 1.0 && level <= 2000.0)) return bad_input("--levels: expected 1 to 2000 K each");
  }
  for (const double ms : pulses) {
    if (!(ms >= 0.1 && ms <= 1e6)) return bad_input("--pulses: expected 0.1 to 1000000 ms each");
  }
  capture::Chopper chopper;
  chopper.cold_k = *cold;
  double on_s = *gap_ms / 1e3;
  for (std::size_t i = 0;; ++i) {
    const double off_s = on_s + pulses[i % pulses.size()] / 1e3;
    if (off_s > duration_s) break;
    chopper.on_s.push_back(on_s);
    chopper.off_s.push_back(off_s);
    chopper.level_k.push_back(levels[i / pulses.size() % levels.size()]);
    on_s = off_s + *gap_ms / 1e3;
  }
  if (chopper.on_s.empty())
    return bad_input("the capture ends before the first pulse of the chopper; take more frames");
  return sim::make_chopper(std::move(chopper));
}

Result<Field> bars_field(const Options& given) {
  struct Value {
    Result<double> value;
    double capture::BarTarget::*field;
  };
  const std::array<Value, 5> values{{{kelvin(given, "cold", 285.0), &capture::BarTarget::cold_k},
                                     {kelvin(given, "hot"), &capture::BarTarget::hot_k},
                                     {ranged(given, "period", 2.0, 1e5), &capture::BarTarget::period_px},
                                     {ranged(given, "slant", -100.0, 100.0), &capture::BarTarget::slant_px_per_row},
                                     {ranged(given, "speed", -1e5, 1e5), &capture::BarTarget::velocity_px_s}}};
  capture::BarTarget target;
  for (const Value& value : values) {
    if (!value.value) return tl::unexpected(value.value.error());
    target.*value.field = *value.value;
  }
  if (target.cold_k >= target.hot_k) return bad_input("--cold must be below --hot");
  target.bar_width_px = target.period_px / 2.0;
  return sim::make_bars(target);
}

Result<sim::Path> camera_motion(const Options& given, const sim::CameraSettings& camera, double from_s, double to_s) {
  if (given.count("trajectory") == 0) {
    for (const char* option : {"trajectory-scale", "trajectory-start"}) {
      if (given.count(option) != 0) return bad_input("--" + std::string(option) + " needs --trajectory");
    }
    return ranged(given, "speed", -1e5, 1e5).map(sim::steady_pan);
  }
  if (given.count("speed") != 0) return bad_input("--speed contradicts --trajectory; leave one out");
  const Result<double> scale = ranged(given, "trajectory-scale", -100.0, 100.0);
  if (!scale) return tl::unexpected(scale.error());
  const auto file = given["trajectory"].as<std::string>();
  const auto points = sim::read_trajectory(file);
  if (!points) return tl::unexpected(points.error());
  const bool has_start = given.count("trajectory-start") != 0;
  const double start_s = has_start ? given["trajectory-start"].as<double>() : points->front().t_s;
  constexpr double kPointsPerFrame = 8.0;
  auto path =
      sim::follow_trajectory(*points, {*scale, start_s, from_s, to_s, 1.0 / (camera.rate_hz * kPointsPerFrame)});
  if (!path) return at(file, path.error());
  return path;
}

Result<std::unique_ptr<const sim::Scene>> scene_of(const Options& given, const sim::CameraSettings& camera) {
  const auto name = given["scene"].as<std::string>();
  const bool street = name == "street";
  const bool has_span = given.count("cold") + given.count("hot") != 0;
  const Result<bool> grey = street ? Result<bool>(false) : sim::has_grey_levels(name);
  if (!grey) return tl::unexpected(grey.error());
  if (has_span && !*grey)
    return bad_input("--cold and --hot are for PNG and JPEG; " + name + " has temperatures of its own");
  if (street) return sim::make_street(camera.geometry, camera.readout.seed);
  const Result<double> cold = kelvin(given, "cold", 285.0);
  if (!cold) return tl::unexpected(cold.error());
  const Result<double> hot = kelvin(given, "hot");
  if (!hot) return tl::unexpected(hot.error());
  if (*cold >= *hot) return bad_input("--cold must be below --hot");
  return sim::read_image(name, {*cold, *hot}).map(sim::make_still_scene);
}

Result<Field> scene_field(const Options& given, const sim::CameraSettings& camera, double from_s, double to_s) {
  const auto scene = scene_of(given, camera);
  if (!scene) return tl::unexpected(scene.error());
  const auto motion = camera_motion(given, camera, from_s, to_s);
  if (!motion) return tl::unexpected(motion.error());
  sim::Position origin = sim::centred_origin(**scene, *motion, camera.geometry, from_s, to_s);
  if (given.count("origin") != 0) {
    const auto xy = given["origin"].as<std::vector<double>>();
    if (xy.size() != 2) return bad_input("--origin: expected X,Y");
    origin = {xy[0], xy[1]};
  }
  return sim::pan_over(**scene, *motion, origin, camera.geometry, from_s, to_s);
}

}  // namespace

Result<std::unique_ptr<const sim::Field>> simulated_field(const cxxopts::ParseResult& given,
                                                          const sim::CameraSettings& camera, std::size_t frames) {
  const Result<StimulusKind> kind = stimulus_kind(given);
  if (!kind) return tl::unexpected(kind.error());
  const double to_s = static_cast<double>(frames) / camera.rate_hz;
  switch (*kind) {
    case kUniform:
      return uniform_field(given);
    case kChopper:
      return chopper_field(given, to_s);
    case kBars:
      return bars_field(given);
    case kScene:
      break;
  }
  return scene_field(given, camera, -sim::history_s(camera), to_s);
}

}  // namespace bolo::tools
