// `bolo deblur`: a capture through the same pipeline as the camera's frames, as fast as it goes.
#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "bolo/capture/capture.hpp"
#include "bolo/capture/pixel_maps_io.hpp"
#include "bolo/core/clock.hpp"
#include "bolo/deblur/isa.hpp"
#include "bolo/model/camera_profile.hpp"
#include "bolo/pipeline/apply_profile.hpp"
#include "bolo/pipeline/pipeline.hpp"
#include "drivers/replay/replay_source.hpp"
#include "tools/verbs/cli.hpp"
#include "tools/verbs/deblur_sink.hpp"
#include "tools/verbs/pixel_choice.hpp"
#include "tools/verbs/verbs.hpp"

namespace bolo::tools {
namespace {

struct Request {
  std::filesystem::path input;
  std::filesystem::path output;
  std::filesystem::path points_file;
  std::filesystem::path profile_file;
  std::filesystem::path maps_file;
  pipeline::PipelineOptions options;
  bool json = false;
};

struct Summary {
  std::uint64_t frames_in = 0;
  std::uint64_t frames_out = 0;
  std::uint64_t lost = 0;
  double ms_per_frame = 0.0;
  double seconds = 0.0;
  deblur::Settings settings;
  int threads = 0;
  std::string isa;
  std::string solver_text;
  std::optional<Rmse> rmse;
  std::optional<Region> region;
  std::size_t points = 0;
  std::string maps;
};

cxxopts::Options command_line() {
  const deblur::Settings defaults;
  const auto text = [](double value) {
    std::array<char, 32> digits{};
    std::snprintf(digits.data(), digits.size(), "%g", value);
    return std::string(digits.data());
  };
  cxxopts::Options options("bolo deblur", "Undo the pixels' thermal inertia in a capture");
  options.positional_help("IN.h5");
  // clang-format off
  options.add_options()
    ("input", "Capture to read", cxxopts::value<std::string>())
    ("o,output", "Capture to write", cxxopts::value<std::string>(), "OUT.h5")
    ("profile", "Camera profile: what is known of the camera and undone", cxxopts::value<std::string>(), "P.toml")
    ("tau", "Thermal time constant, s (default: the profile's, else " + text(defaults.tau_s) + ")",
     cxxopts::value<double>(), "S")
    ("solver", "admm, dual, exact, inverse or mmae", cxxopts::value<std::string>()->default_value("admm"))
    ("iterations", "ADMM iterations; 0: as many as the accuracy needs",
     cxxopts::value<int>()->default_value(text(defaults.iterations)), "I")
    ("kappa", "Weight of the data in kappa ||VA - Y||^2 + lambda ||D||_1",
     cxxopts::value<double>()->default_value(text(defaults.kappa)), "K")
    ("lambda", "Weight of sparsity, K (counts for a capture without kelvin), or auto: from noise and motion",
     cxxopts::value<std::string>()->default_value(text(defaults.lambda)), "L")
    ("noise", "Temporal noise for --lambda auto and mmae, K (counts as lambda); 0: measured",
     cxxopts::value<double>()->default_value(text(defaults.noise_k)), "N")
    ("lookahead", "Frames that the window reaches beyond the estimated one",
     cxxopts::value<int>()->default_value(text(defaults.lookahead)), "L")
    ("window", "Frames in the window, 2^k + 1", cxxopts::value<int>()->default_value(text(defaults.window)), "N")
    ("levels", "Haar levels n: 2^n bins in the window",
     cxxopts::value<int>()->default_value(text(defaults.levels)), "N")
    ("threads", "Worker threads (default: one a processor)", cxxopts::value<int>(), "W")
    ("isa", "Instruction set of the kernels, or auto: the best", cxxopts::value<std::string>()->default_value("auto"),
     "NAME")
    ("roi", "Only this part of the frame", cxxopts::value<std::vector<int>>(), "x,y,w,h")
    ("points", "Only these pixels: a line x,y for each", cxxopts::value<std::string>(), "P.csv")
    ("type", "float32 (kelvin) or uint16 (the input's scale)",
     cxxopts::value<std::string>()->default_value("float32"))
    ("json", "Print the summary as JSON");
  // clang-format on
  options.parse_positional({"input"});
  return options;
}

// A number, or "auto".
Status read_lambda(const std::string& text, deblur::Settings& settings) {
  settings.auto_lambda = text == "auto";
  if (settings.auto_lambda) return {};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, settings.lambda);
  if (error == std::errc() && stop == end) return {};
  return bad_input("--lambda '" + text + "': give a number of 0 or more, or auto");
}

Status read_profile(const cxxopts::ParseResult& args, Request& request) {
  if (args.count("profile") == 0) return {};
  request.profile_file = args["profile"].as<std::string>();
  const auto profile = model::read_profile(request.profile_file);
  if (!profile) return tl::unexpected(profile.error());
  request.maps_file = profile->maps;
  auto maps = capture::read_profile_maps(*profile);
  if (!maps) return tl::unexpected(maps.error());
  pipeline::apply_profile(*profile, std::move(*maps), request.options);
  return {};
}

Status read_settings(const cxxopts::ParseResult& args, deblur::Settings& settings) {
  const auto method = deblur::method_from_name(args["solver"].as<std::string>());
  if (!method) return at("--solver", method.error());
  settings.method = *method;
  settings.iterations = args["iterations"].as<int>();
  settings.lookahead = args["lookahead"].as<int>();
  settings.window = args["window"].as<int>();
  settings.levels = args["levels"].as<int>();
  if (args.count("tau") != 0) settings.tau_s = args["tau"].as<double>();
  settings.kappa = args["kappa"].as<double>();
  settings.noise_k = args["noise"].as<double>();
  return read_lambda(args["lambda"].as<std::string>(), settings);
}

Result<PixelType> type_from_name(const std::string& name) {
  if (name == "float32") return PixelType::kFloat32;
  if (name == "uint16") return PixelType::kUint16;
  return bad_input("--type '" + name + "': give float32 or uint16");
}

Result<Request> read_request(const cxxopts::ParseResult& args) {
  if (args.count("input") == 0) return bad_input("no capture given; usage: bolo deblur IN.h5 -o OUT.h5");
  if (args.count("output") == 0) return bad_input("no output given; add -o OUT.h5");
  Request request;
  request.input = args["input"].as<std::string>();
  request.output = args["output"].as<std::string>();
  request.json = args.count("json") != 0;
  std::error_code ignored;
  if (std::filesystem::equivalent(request.input, request.output, ignored)) {
    return bad_input(request.output.string() + ": the output is the input; give another name with -o");
  }
  if (Status status = read_profile(args, request); !status) return tl::unexpected(status.error());
  if (Status status = read_settings(args, request.options.deblur); !status) return tl::unexpected(status.error());
  if (Status status = deblur::choose_isa(args["isa"].as<std::string>()); !status) return at("--isa", status.error());
  const auto type = type_from_name(args["type"].as<std::string>());
  if (!type) return tl::unexpected(type.error());
  request.options.output = *type;
  const int processors = static_cast<int>(std::thread::hardware_concurrency());
  request.options.workers = args.count("threads") != 0 ? args["threads"].as<int>() : std::max(1, processors);
  if (args.count("roi") != 0) {
    const auto roi = args["roi"].as<std::vector<int>>();
    if (roi.size() != 4) return bad_input("--roi takes four numbers: x,y,width,height");
    request.options.region = Region{roi[0], roi[1], roi[2], roi[3]};
  }
  if (args.count("points") != 0) {
    if (request.options.region) return bad_input("--roi and --points: give one of them");
    request.points_file = args["points"].as<std::string>();
  }
  return request;
}

// What can be said of the input before any work.
Status check_input(const Request& request, const capture::CaptureInfo& info) {
  deblur::Settings settings = request.options.deblur;
  if (Status status = deblur::validate(settings); !status) return status;
  settings.period_s = info.format.frame_period_s;
  if (Status status = deblur::validate(settings); !status) return at(request.input.string(), status.error());
  if (info.frames < static_cast<std::size_t>(settings.window)) {
    return bad_input(request.input.string() + ": " + std::to_string(info.frames) +
                     " frames, fewer than one window of " + std::to_string(settings.window) +
                     "; record longer or give a smaller --window");
  }
  if (request.options.output == PixelType::kUint16 && info.format.type != PixelType::kUint16) {
    return bad_input(request.input.string() + ": /frames is float32, which has no uint16 scale; use --type float32");
  }
  return {};
}

// The first thing that went wrong while the frames flowed.
Status outcome(const Request& request, const Status& run, const Status& replay, const DeblurSink& sink) {
  if (!run) return run;
  if (!replay) return replay;
  if (!sink.status()) return sink.status();
  if (interrupted().load(std::memory_order_relaxed)) {
    return failed("interrupted; " + request.output.string() + " was not written");
  }
  if (sink.frames_out() == 0) {
    return bad_input(request.input.string() + ": no full window of " + std::to_string(request.options.deblur.window) +
                     " frames between its breaks (events, jumps in time); give a smaller --window");
  }
  return {};
}

// Root attributes of the output beyond the settings.
std::vector<std::pair<std::string, std::string>> file_names(const Request& request) {
  std::vector<std::pair<std::string, std::string>> names;
  if (!request.points_file.empty()) names.emplace_back("points_file", request.points_file.filename().string());
  if (!request.profile_file.empty()) names.emplace_back("profile", request.profile_file.filename().string());
  if (!request.maps_file.empty()) names.emplace_back("maps", request.maps_file.filename().string());
  return names;
}

Result<Summary> deblur_capture(Request& request) {
  auto reader = capture::CaptureReader::open(request.input);
  if (!reader) return tl::unexpected(reader.error());
  if (Status status = check_input(request, reader->info()); !status) return tl::unexpected(status.error());
  for (const std::string& line : reader->warnings()) {
    std::fprintf(stderr, "bolo deblur: %s: %s\n", request.input.c_str(), line.c_str());
  }
  auto own_reader = capture::CaptureReader::open(request.input);
  if (!own_reader) return tl::unexpected(own_reader.error());

  const std::size_t frames = reader->info().frames;
  const Geometry whole = reader->info().format.geometry;
  pipeline::PipelineOptions& options = request.options;
  if (!request.points_file.empty()) {
    auto points = read_points(request.points_file, whole);
    if (!points) return tl::unexpected(points.error());
    options.points = std::move(*points);
  }
  DeblurSink sink(request.input, std::move(*own_reader), request.output,
                  PixelChoice(whole, options.region, options.points));
  auto source = std::make_unique<replay::ReplaySource>(
      std::make_shared<const capture::CaptureReader>(std::move(*reader)), replay::Pace::kAsFastAsPossible);
  const replay::ReplaySource& replayed = *source;
  auto pipeline = pipeline::Pipeline::create(std::move(source), {&sink}, request.options);
  if (!pipeline) return tl::unexpected(pipeline.error());

  const std::int64_t start_ns = monotonic_ns();
  const Status run = (*pipeline)->run(sink.stop_requested());
  if (Status status = outcome(request, run, replayed.result(), sink); !status) return tl::unexpected(status.error());
  if (Status status = sink.finish((*pipeline)->isa(), file_names(request)); !status)
    return tl::unexpected(status.error());

  const pipeline::PipelineStats& stats = (*pipeline)->stats();
  Summary summary;
  summary.frames_in = frames;
  summary.frames_out = sink.frames_out();
  summary.lost = stats.inlet.losses().total();
  summary.ms_per_frame =
      static_cast<double>(stats.deblur_ns.value()) * kMsPerNs / static_cast<double>(sink.frames_out());
  summary.seconds = static_cast<double>(monotonic_ns() - start_ns) / kNsPerSecond;
  summary.settings = (*pipeline)->settings();
  summary.threads = request.options.workers;
  summary.isa = (*pipeline)->isa();
  summary.solver_text = (*pipeline)->solver_text();
  summary.rmse = sink.rmse();
  summary.region = options.region;
  summary.points = options.points.size();
  summary.maps = request.maps_file.filename().string();
  return summary;
}

void print_json(const Summary& s) {
  nlohmann::ordered_json json{{"frames_in", s.frames_in},
                              {"frames_out", s.frames_out},
                              {"lost", s.lost},
                              {"ms_per_frame", s.ms_per_frame},
                              {"seconds", s.seconds}};
  json["settings"] = {{"solver", deblur::name(s.settings.method)},
                      {"tau_s", s.settings.tau_s},
                      {"period_s", s.settings.period_s},
                      {"kappa", s.settings.kappa},
                      {"lambda", s.settings.lambda},
                      {"auto_lambda", s.settings.auto_lambda},
                      {"noise_k", s.settings.noise_k},
                      {"iterations", s.settings.iterations},
                      {"window", s.settings.window},
                      {"levels", s.settings.levels},
                      {"lookahead", s.settings.lookahead},
                      {"threads", s.threads},
                      {"isa", s.isa}};
  json["roi"] = nullptr;
  if (s.region) json["roi"] = in_words(*s.region);
  json["points"] = s.points;
  json["maps"] = s.maps;
  json["rmse"] = nullptr;
  if (s.rmse) json["rmse"] = {{"blurred_k", s.rmse->blurred_k}, {"deblurred_k", s.rmse->deblurred_k}};
  std::puts(json.dump(2).c_str());
}

void print_text(const Request& request, const Summary& s) {
  std::printf("%s: %llu of %llu frames (%llu lost before), %s, %.3f ms a frame on %d threads, %.1f s\n",
              request.output.c_str(), static_cast<unsigned long long>(s.frames_out),
              static_cast<unsigned long long>(s.frames_in), static_cast<unsigned long long>(s.lost),
              s.solver_text.c_str(), s.ms_per_frame, s.threads, s.seconds);
  if (s.rmse)
    std::printf("against the truth: blurred %.4f K, deblurred %.4f K rms\n", s.rmse->blurred_k, s.rmse->deblurred_k);
}

}  // namespace

int deblur_main(int argc, char** argv) {
  cxxopts::Options options = command_line();
  cxxopts::ParseResult args;
  if (const auto code = parse(options, argc, argv, args)) return *code;
  Result<Request> request = read_request(args);
  if (!request) return report("deblur", request.error());
  request->options.warn = [](const std::string& line) { std::fprintf(stderr, "bolo deblur: %s\n", line.c_str()); };
  catch_interrupts();
  const auto summary = deblur_capture(*request);
  if (!summary) return report("deblur", summary.error());
  request->json ? print_json(*summary) : print_text(*request, *summary);
  return kExitDone;
}

}  // namespace bolo::tools
