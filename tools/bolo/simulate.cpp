// bolo simulate: a capture of a simulated camera, with its truth and its stimulus.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tools/bolo/listings.hpp"
#include "tools/bolo/simulate_field.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using Options = cxxopts::ParseResult;

cxxopts::Options simulate_options() {
  cxxopts::Options options("bolo simulate", "Writes a capture of a simulated camera, with its truth and its stimulus");
  const auto text = [](const char* value = nullptr) {
    return value != nullptr ? cxxopts::value<std::string>()->default_value(value) : cxxopts::value<std::string>();
  };
  const auto number = [](const char* value) { return cxxopts::value<double>()->default_value(value); };
  const auto list = [](const char* value) { return cxxopts::value<std::vector<double>>()->default_value(value); };
  options.add_options("Output")("o,output", "Capture to write", text(), "OUT.h5")(
      "no-truth", "Leave out /truth: the file shrinks to a third")("compress", "Deflate the frames (level 1)")(
      "json", "Print the result as JSON");
  add_overwrite_option(options);
  options.add_options("Camera")("width", "Pixels", cxxopts::value<int>()->default_value("640"))(
      "height", "Pixels", cxxopts::value<int>()->default_value("120"))("rate", "Frames a second", number("200"))(
      "frames", "How many", cxxopts::value<std::int64_t>()->default_value("400"))(
      "camera", "bolometer (thermal inertia) or visible (mean over the exposure)", text("bolometer"))(
      "tau", "Thermal time constant, s (bolometer)", number("0.011"))(
      "exposure", "s, ends at the frame's time (visible; default: the frame period, at most 5 ms)",
      cxxopts::value<double>())("noise", "White noise, K rms", number("0.03"))(
      "quantisation", "K a step (uint16: default 0.01; float32: default none)", cxxopts::value<double>())(
      "type", "uint16 or float32", text("uint16"))("seed", "Of the noise and the street",
                                                   cxxopts::value<std::uint64_t>()->default_value("1"))(
      "threads", "The result does not depend on them", cxxopts::value<int>()->default_value("2"));
  options.add_options("Effects")("effect", "What the camera does beyond the nominal one; may be given again", text(),
                                 "NAME[:key=value,...]")("list-effects", "Print all effects with their keys, and end")(
      "camera-seed", "Of what is fixed in the camera, such as patterns (default: the seed)",
      cxxopts::value<std::uint64_t>())("session-start", "s that the camera had been on at t = 0", number("0"));
  options.add_options("Scene")("stimulus", "uniform, chopper, bar_target or scene (default)", text())(
      "stimulus-error",
      "How the bench differs from what is written to /stimulus: sweep_s, softness_s, start_s, cold_k, "
      "level_k, level2_k, velocity, uneven, uneven_period_s, uneven_phase, phase, edge_px, reflection, surroundings_k",
      text(), "key=value,...")("scene", "street, bars, or a picture: PNG, JPEG, HDF5 with image_k", text("street"))(
      "speed", "What the camera sees moves along +x, pixels/s", number("300"))(
      "trajectory", "CSV of t_s,x_px,y_px: where pixel (0, 0) looks", text(), "FILE.csv")(
      "trajectory-scale", "Of the trajectory's motion", number("1"))(
      "trajectory-start", "Time in the trajectory where the capture begins, s", cxxopts::value<double>())(
      "origin", "Scene pixel that (0, 0) looks at, at t = 0 (default: the path is centred)",
      cxxopts::value<std::vector<double>>(),
      "X,Y")("cold", "K: black of a picture, the bars' ground (285), the closed chopper (295)",
             cxxopts::value<double>())("hot", "K: white of a picture, the bars", number("310"))(
      "temperature", "K (uniform)", number("300"))("levels", "K: heights of the pulses (chopper)", list("305,320"))(
      "pulses", "ms: lengths of the pulses (chopper)", list("12,30,60,120,300"))(
      "gap", "ms: between two pulses (chopper)", number("83.7"))("period", "Pixels (bar_target)", number("40"))(
      "slant", "Pixels a row (bar_target)", number("0.25"));
  return options;
}

Result<std::vector<sim::EffectSpec>> effects_of(const Options& given) {
  std::vector<sim::EffectSpec> effects;
  for (const auto& argument : given.arguments()) {  // a list would be split at the commas
    if (argument.key() != "effect") continue;
    auto effect = sim::parse_effect(argument.value());
    if (!effect) return at("--effect", effect.error());
    effects.push_back(std::move(*effect));
  }
  return effects;
}

Result<sim::CameraSettings> camera_of(const Options& given) {
  sim::CameraSettings camera;
  camera.geometry = {given["width"].as<int>(), given["height"].as<int>()};
  camera.rate_hz = given["rate"].as<double>();
  camera.tau_s = given["tau"].as<double>();
  camera.threads = given["threads"].as<int>();
  const auto kind = given["camera"].as<std::string>();
  if (kind != "bolometer" && kind != "visible")
    return bad_input("--camera " + kind + ": expected bolometer or visible");
  camera.kind = kind == "visible" ? sim::CameraKind::kVisible : sim::CameraKind::kBolometer;
  const char* const foreign = kind == "visible" ? "tau" : "exposure";
  if (given.count(foreign) != 0)
    return bad_input("--" + std::string(foreign) + " has no meaning with --camera " + kind);
  camera.exposure_s =
      given.count("exposure") != 0 ? given["exposure"].as<double>() : std::min(0.005, 1.0 / camera.rate_hz);
  const auto type = given["type"].as<std::string>();
  if (type != "uint16" && type != "float32") return bad_input("--type " + type + ": expected uint16 or float32");
  camera.readout.type = type == "uint16" ? PixelType::kUint16 : PixelType::kFloat32;
  camera.readout.noise_k = given["noise"].as<double>();
  camera.readout.quantisation_k = type == "uint16" ? 0.01 : 0.0;
  if (given.count("quantisation") != 0) camera.readout.quantisation_k = given["quantisation"].as<double>();
  camera.readout.seed = given["seed"].as<std::uint64_t>();
  auto effects = effects_of(given);
  if (!effects) return tl::unexpected(effects.error());
  camera.effects = std::move(*effects);
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
  if (Status good = check_outputs({file.path}, inputs, file.replace); !good) return tl::unexpected(good.error());
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
    std::puts(result.dump().c_str());
    return;
  }
  std::printf("%s: %llu frames of %dx%d, %g s, %.1f MB\n", file.c_str(),
              static_cast<unsigned long long>(simulator.frames_done()), camera.geometry.width, camera.geometry.height,
              seconds, static_cast<double>(bytes) / 1e6);
}

Result<std::unique_ptr<const sim::Field>> field_of(const Options& given, const sim::CameraSettings& camera,
                                                   std::size_t frames) {
  auto field = simulated_field(given, camera, frames);
  if (!field || given.count("stimulus-error") == 0) return field;
  const auto error = sim::parse_stimulus_error(given["stimulus-error"].as<std::string>());
  if (!error) return at("--stimulus-error", error.error());
  field = sim::with_errors(std::move(*field), *error, camera.geometry);
  if (!field) return at("--stimulus-error", field.error());
  return field;
}

Status simulate(const Options& given) {
  const auto file = output_of(given);
  if (!file) return tl::unexpected(file.error());
  const auto camera = camera_of(given);
  if (!camera) return tl::unexpected(camera.error());
  const auto frames = frames_of(given);
  if (!frames) return tl::unexpected(frames.error());
  auto field = field_of(given, *camera, *frames);
  if (!field) return tl::unexpected(field.error());
  const auto simulator = sim::Simulator::create(*camera, std::move(*field));
  if (!simulator) return tl::unexpected(simulator.error());

  catch_interrupts();
  const sim::CaptureOptions options{*frames, given.count("no-truth") == 0, given.count("compress") != 0 ? 1 : 0};
  Status status;
  {
    Progress progress("simulate", *frames);
    status = sim::write_capture(**simulator, *file, options, [&progress](std::size_t done) {
      progress.update(done);
      return !interrupted().load(std::memory_order_relaxed);
    });
  }
  if (!status) return status;
  print_result(given, file->path, **simulator);
  if ((*simulator)->frames_done() < *frames) return failed("interrupted; the capture holds the frames until then");
  return {};
}

}  // namespace

int simulate_main(int argc, char** argv) {
  cxxopts::Options options = simulate_options();
  Options given;
  if (const auto code = parse(options, argc, argv, given)) return *code;
  try {
    if (given.count("list-effects") != 0) {
      print_effects(given.count("json") != 0);
      return kExitDone;
    }
    const Status status = simulate(given);
    return status ? kExitDone : report("simulate", status.error());
  } catch (const std::bad_alloc&) {
    return report("simulate", Error{ErrorKind::kFailed, "not enough memory; take fewer frames or a smaller frame"});
  }
}

}  // namespace bolo::tools
