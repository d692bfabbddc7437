// bolo simulate: writes a capture of a simulated camera, with its truth and its stimulus.
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <cxxopts.hpp>
#include <nlohmann/json.hpp>

#include "src/core/result.hpp"
#include "src/core/text.hpp"
#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

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

// The stimulus selected by --stimulus and --scene; every given option must apply to it.
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

Result<double> kelvin(const Options& given, const char* option, double fallback = 0.0) {
  if (given.count(option) == 0 && fallback > 0.0) return fallback;
  return number_of<double>(given, option, 1.0, 2000.0);
}

Result<Field> uniform_field(const Options& given) {
  return kelvin(given, "temperature").map([](double k) { return sim::make_uniform(k); });
}

// Every length at every level, repeated while pulses end within the capture. The default gap is no multiple of a frame,
// so that the pulses start at many phases of it.
Result<Field> chopper_field(const Options& given, double duration_s) {
  ASSIGN_OR_RETURN(const double cold, kelvin(given, "cold", 295.0));
  ASSIGN_OR_RETURN(const double gap_ms, number_of<double>(given, "gap", 0.1, 1e6));
  const auto levels = given["levels"].as<std::vector<double>>();
  const auto pulses = given["pulses"].as<std::vector<double>>();
  for (const double level : levels) {
    if (!(level >= 1.0 && level <= 2000.0)) return bad_input("--levels: expected 1 to 2000 K each");
  }
  for (const double ms : pulses) {
    if (!(ms >= 0.1 && ms <= 1e6)) return bad_input("--pulses: expected 0.1 to 1000000 ms each");
  }
  capture::Chopper chopper;
  chopper.cold_k = cold;
  double on_s = gap_ms / 1e3;
  for (std::size_t i = 0;; ++i) {
    const double off_s = on_s + pulses[i % pulses.size()] / 1e3;
    if (off_s > duration_s) break;
    chopper.on_s.push_back(on_s);
    chopper.off_s.push_back(off_s);
    chopper.level_k.push_back(levels[i / pulses.size() % levels.size()]);
    on_s = off_s + gap_ms / 1e3;
  }
  if (chopper.on_s.empty())
    return bad_input("the capture ends before the first pulse of the chopper; take more frames");
  return sim::make_chopper(std::move(chopper));
}

Result<Field> bars_field(const Options& given) {
  capture::BarTarget target;
  ASSIGN_OR_RETURN(target.cold_k, kelvin(given, "cold", 285.0));
  ASSIGN_OR_RETURN(target.hot_k, kelvin(given, "hot"));
  ASSIGN_OR_RETURN(target.period_px, number_of<double>(given, "period", 2.0, 1e5));
  ASSIGN_OR_RETURN(target.slant_px_per_row, number_of<double>(given, "slant", -100.0, 100.0));
  ASSIGN_OR_RETURN(target.velocity_px_s, number_of<double>(given, "speed", -1e5, 1e5));
  if (target.cold_k >= target.hot_k) return bad_input("--cold must be below --hot");
  target.bar_width_px = target.period_px / 2.0;
  return sim::make_bars(target);
}

Result<sim::Path> camera_motion(const Options& given, const sim::CameraSettings& camera, double from_s, double to_s) {
  if (given.count("trajectory") == 0) {
    for (const char* option : {"trajectory-scale", "trajectory-start"}) {
      if (given.count(option) != 0) return bad_input("--" + std::string(option) + " needs --trajectory");
    }
    return number_of<double>(given, "speed", -1e5, 1e5).map(sim::steady_pan);
  }
  if (given.count("speed") != 0) return bad_input("--speed contradicts --trajectory; leave one out");
  ASSIGN_OR_RETURN(const double scale, number_of<double>(given, "trajectory-scale", -100.0, 100.0));
  const auto file = given["trajectory"].as<std::string>();
  ASSIGN_OR_RETURN(const auto points, sim::read_trajectory(file));
  const bool has_start = given.count("trajectory-start") != 0;
  const double start_s = has_start ? given["trajectory-start"].as<double>() : points.front().t_s;
  constexpr double kPointsPerFrame = 8.0;
  ASSIGN_OR_RETURN(auto path, at(file, sim::follow_trajectory(points, {scale, start_s, from_s, to_s,
                                                                       1.0 / (camera.rate_hz * kPointsPerFrame)})));
  return path;
}

Result<std::unique_ptr<const sim::Scene>> scene_of(const Options& given, const sim::CameraSettings& camera) {
  const auto name = given["scene"].as<std::string>();
  const bool street = name == "street";
  const bool has_span = given.count("cold") + given.count("hot") != 0;
  ASSIGN_OR_RETURN(const bool grey, street ? Result<bool>(false) : sim::has_grey_levels(name));
  if (has_span && !grey)
    return bad_input("--cold and --hot are for PNG and JPEG; " + name + " has temperatures of its own");
  if (street) return sim::make_street(camera.geometry, camera.readout.seed);
  ASSIGN_OR_RETURN(const double cold, kelvin(given, "cold", 285.0));
  ASSIGN_OR_RETURN(const double hot, kelvin(given, "hot"));
  if (cold >= hot) return bad_input("--cold must be below --hot");
  return sim::read_image(name, {cold, hot}).map(sim::make_still_scene);
}

Result<Field> scene_field(const Options& given, const sim::CameraSettings& camera, double from_s, double to_s) {
  ASSIGN_OR_RETURN(const auto scene, scene_of(given, camera));
  ASSIGN_OR_RETURN(const auto motion, camera_motion(given, camera, from_s, to_s));
  sim::Position origin = sim::centred_origin(*scene, motion, camera.geometry, from_s, to_s);
  if (given.count("origin") != 0) {
    const auto xy = given["origin"].as<std::vector<double>>();
    if (xy.size() != 2) return bad_input("--origin: expected X,Y");
    origin = {xy[0], xy[1]};
  }
  return sim::pan_over(*scene, motion, origin, camera.geometry, from_s, to_s);
}

cxxopts::Options simulate_options() {
  cxxopts::Options options("bolo simulate", "Simulate a camera: write a capture with its truth and stimulus.");
  const auto text = [](const char* value = nullptr) {
    return value != nullptr ? cxxopts::value<std::string>()->default_value(value) : cxxopts::value<std::string>();
  };
  const auto number = [](const char* value) { return cxxopts::value<double>()->default_value(value); };
  const auto list = [](const char* value) { return cxxopts::value<std::vector<double>>()->default_value(value); };
  auto output = options.add_options("Output");
  output("o,output", "Capture to write", text(), "OUT.h5");
  output("no-truth", "Omit /truth, which makes the file a third as large");
  output("compress", "Deflate the frames (level 1)");
  output("json", "Print the result as JSON");
  add_overwrite_option(options);
  auto camera = options.add_options("Camera");
  camera("width", "Columns, pixels", cxxopts::value<int>()->default_value("640"));
  camera("height", "Rows, pixels", cxxopts::value<int>()->default_value("120"));
  camera("rate", "Frames per second", number("200"));
  camera("frames", "Number of frames", cxxopts::value<std::int64_t>()->default_value("400"));
  camera("tau", "Thermal time constant, s", number("0.011"));
  camera("noise", "White noise, K rms", number("0.03"));
  camera("quantisation", "Quantisation step, K (uint16: default 0.01; float32: default none)",
         cxxopts::value<double>());
  camera("type", "uint16 or float32", text("uint16"));
  camera("seed", "Seed of the noise and the street", cxxopts::value<std::uint64_t>()->default_value("1"));
  camera("threads", "Worker threads; the result does not depend on their number",
         cxxopts::value<int>()->default_value("2"));
  auto effects = options.add_options("Effects");
  effects("effect", "Effect beyond the nominal camera; repeatable", text(), "NAME[:key=value,...]");
  effects("list-effects", "Print all effects with their keys, and exit");
  effects("camera-seed", "Seed of the camera's fixed properties, such as patterns (default: --seed)",
          cxxopts::value<std::uint64_t>());
  effects("session-start", "Time since the camera was switched on at t = 0, s", number("0"));
  auto scene = options.add_options("Scene");
  scene("stimulus", "Stimulus: uniform, chopper, bar_target or scene (default)", text());
  scene(
      "stimulus-error",
      "Errors of the bench against its description in /stimulus: sweep_s, softness_s, start_s, cold_k, "
      "level_k, level2_k, velocity, uneven, uneven_period_s, uneven_phase, phase, edge_px, reflection, surroundings_k",
      text(), "key=value,...");
  scene("scene", "street, bars, or a picture: PNG, JPEG, HDF5 with image_k", text("street"));
  scene("speed", "Speed of the scene along +x, pixels/s", number("300"));
  scene("trajectory", "CSV of t_s,x_px,y_px: scene position of pixel (0, 0)", text(), "FILE.csv");
  scene("trajectory-scale", "Factor on the trajectory's motion", number("1"));
  scene("trajectory-start", "Start time within the trajectory, s", cxxopts::value<double>());
  scene("origin", "Scene position of pixel (0, 0) at t = 0 (default: centres the path)",
        cxxopts::value<std::vector<double>>(), "X,Y");
  scene("cold", "Cold temperature, K: a picture's black, the bars' background (285), the closed chopper (295)",
        cxxopts::value<double>());
  scene("hot", "Hot temperature, K: a picture's white, the bars", number("310"));
  scene("temperature", "Uniform field: temperature, K", number("300"));
  scene("levels", "Chopper: levels of the pulses, K", list("305,320"));
  scene("pulses", "Chopper: lengths of the pulses, ms", list("12,30,60,120,300"));
  scene("gap", "Chopper: gap between pulses, ms", number("83.7"));
  scene("period", "Bar target: period, pixels", number("40"));
  scene("slant", "Bar target: slant, pixels per row", number("0.25"));
  return options;
}

Result<std::vector<sim::EffectSpec>> effects_of(const Options& given) {
  std::vector<sim::EffectSpec> effects;
  for (const auto& argument : given.arguments()) {  // a list would be split at commas
    if (argument.key() != "effect") continue;
    ASSIGN_OR_RETURN(auto effect, at("--effect", sim::parse_effect(argument.value())));
    effects.push_back(std::move(effect));
  }
  return effects;
}

Result<sim::CameraSettings> camera_of(const Options& given) {
  sim::CameraSettings camera;
  camera.geometry = {given["width"].as<int>(), given["height"].as<int>()};
  camera.rate_hz = given["rate"].as<double>();
  camera.tau_s = given["tau"].as<double>();
  camera.threads = given["threads"].as<int>();
  const auto type = given["type"].as<std::string>();
  if (type != "uint16" && type != "float32") return bad_input("--type " + type + ": expected uint16 or float32");
  camera.readout.type = type == "uint16" ? PixelType::kUint16 : PixelType::kFloat32;
  camera.readout.noise_k = given["noise"].as<double>();
  camera.readout.quantisation_k = type == "uint16" ? 0.01 : 0.0;
  if (given.count("quantisation") != 0) camera.readout.quantisation_k = given["quantisation"].as<double>();
  camera.readout.seed = given["seed"].as<std::uint64_t>();
  ASSIGN_OR_RETURN(camera.effects, effects_of(given));
  if (given.count("camera-seed") != 0) camera.camera_seed = given["camera-seed"].as<std::uint64_t>();
  camera.session_start_s = given["session-start"].as<double>();
  return sim::checked(camera);
}

Result<std::size_t> frames_of(const Options& given) {
  const auto frames = given["frames"].as<std::int64_t>();
  if (frames < 1 || frames > 100'000'000) return bad_input("--frames: expected 1 to 100000000");
  return static_cast<std::size_t>(frames);
}

Result<OutputFile> output_of(const Options& given) {
  if (given.count("output") == 0) return bad_input("no output; give -o OUT.h5");
  OutputFile file(given["output"].as<std::string>(), replace_of(given));
  std::vector<std::filesystem::path> inputs;
  for (const char* input : {"scene", "trajectory"}) {
    if (given.count(input) != 0) inputs.emplace_back(given[input].as<std::string>());
  }
  RETURN_IF_ERROR(check_outputs({file.path}, inputs, file.replace));
  return file;
}

void print_result(const Options& given, const std::filesystem::path& file, const sim::Simulator& simulator) {
  std::error_code ignored;
  const auto bytes = std::filesystem::file_size(file, ignored);
  const sim::CameraSettings& camera = simulator.settings();
  const double seconds = static_cast<double>(simulator.frames_done()) / camera.rate_hz;
  if (given.count("json") != 0) {
    const nlohmann::json result{{"file", file.string()},
                                {"frames", simulator.frames_done()},
                                {"width", camera.geometry.width},
                                {"height", camera.geometry.height},
                                {"seconds", seconds},
                                {"bytes", bytes}};
    std::puts(json_text(result).c_str());
    return;
  }
  std::printf("%s: %llu frames of %dx%d, %g s, %.1f MB\n", printable(file.string()).c_str(),
              static_cast<unsigned long long>(simulator.frames_done()), camera.geometry.width, camera.geometry.height,
              seconds, static_cast<double>(bytes) / 1e6);
}

Result<Field> nominal_field(const Options& given, const sim::CameraSettings& camera, std::size_t frames) {
  ASSIGN_OR_RETURN(const StimulusKind kind, stimulus_kind(given));
  const double to_s = static_cast<double>(frames) / camera.rate_hz;
  if (kind == kUniform) return uniform_field(given);
  if (kind == kChopper) return chopper_field(given, to_s);
  if (kind == kBars) return bars_field(given);
  return scene_field(given, camera, -sim::history_s(camera), to_s);
}

// The field for `frames` frames. kBadInput: contradictory options, or options that do not apply to the stimulus.
Result<Field> field_of(const Options& given, const sim::CameraSettings& camera, std::size_t frames) {
  auto field = nominal_field(given, camera, frames);
  if (!field || given.count("stimulus-error") == 0) return field;
  ASSIGN_OR_RETURN(const auto error,
                   at("--stimulus-error", sim::parse_stimulus_error(given["stimulus-error"].as<std::string>())));
  field = sim::with_errors(std::move(*field), error, camera.geometry);
  if (!field) return at("--stimulus-error", field.error());
  return field;
}

Status simulate(const Options& given) {
  if (given.count("list-effects") != 0) {
    print_effects(given.count("json") != 0);
    return {};
  }
  ASSIGN_OR_RETURN(const auto file, output_of(given));
  ASSIGN_OR_RETURN(const auto camera, camera_of(given));
  ASSIGN_OR_RETURN(const auto frames, frames_of(given));
  ASSIGN_OR_RETURN(auto field, field_of(given, camera, frames));
  ASSIGN_OR_RETURN(const auto simulator, sim::Simulator::create(camera, std::move(field)));

  catch_interrupts();
  const sim::CaptureOptions options{frames, given.count("no-truth") == 0, given.count("compress") != 0 ? 1 : 0};
  const Status written = [&] {
    Progress progress("simulate", frames);
    return sim::write_capture(*simulator, file, options, [&progress](std::size_t done) {
      progress.update(done);
      return !interrupted();
    });
  }();
  RETURN_IF_ERROR(written);
  if (const auto done = simulator->frames_done(); done < frames) {
    return tl::unexpected(interrupted_after(done, file.path));
  }
  print_result(given, file.path, *simulator);
  return {};
}

}  // namespace

int simulate_main(int argc, char** argv) {
  return run_verb("simulate", simulate_options(), argc, argv, simulate, false);
}

}  // namespace bolo::tools
