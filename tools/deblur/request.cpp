#include "tools/deblur/request.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>
#include <set>
#include <string_view>
#include <system_error>
#include <thread>

#include <fmt/format.h>

#include "src/capture/pixel_maps_io.hpp"
#include "src/core/clock.hpp"
#include "src/core/number_rows.hpp"
#include "src/core/text.hpp"
#include "src/deblur/isa.hpp"
#include "src/model/camera_profile.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tools/cli/cli.hpp"
#include "tools/deblur/made_from.hpp"
#include "tools/deblur/pixel_choice.hpp"

namespace bolo::tools {
namespace {

constexpr std::size_t kMostShares = 1'000'000;

std::optional<std::size_t> count_of(const Environment& environment, const char* name) {
  const char* const text = environment(name);
  return text != nullptr ? whole_number<std::size_t>(std::string_view(text)) : std::nullopt;
}

tl::unexpected<Error> contradiction(const std::string& from) {
  return bad_input(from + " do not name one of several processes; say which with --shard I/N");
}

struct RankVariables {
  const char* rank;
  const char* size;
};

// The order matters: ranks that mpirun starts in a Slurm job also have Slurm's variables, which are those of its
// daemons. PMIx has no variable for the number of ranks.
constexpr std::array<RankVariables, 4> kLaunchers{{{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                                                   {"PMI_RANK", "PMI_SIZE"},
                                                   {"SLURM_PROCID", "SLURM_NTASKS"},
                                                   {"PMIX_RANK", "SLURM_NTASKS"}}};

// A batch script is not a task of srun, though Slurm sets the variables of one.
bool is_batch_script(const Environment& environment) {
  return environment("SLURM_JOB_ID") != nullptr && environment("SLURM_STEP_ID") == nullptr;
}

Result<Share> rank_of(const Environment& environment) {
  for (const RankVariables& launcher : kLaunchers) {
    const bool slurm = std::string_view(launcher.rank) == "SLURM_PROCID";
    if (environment(launcher.rank) == nullptr || (slurm && is_batch_script(environment))) continue;
    const auto rank = count_of(environment, launcher.rank);
    const auto size = count_of(environment, launcher.size);
    const std::string from = std::string(launcher.rank) + " and " + launcher.size;
    if (!rank || !size || *size > kMostShares || *rank >= *size) return contradiction(from);
    return Share{*rank, *size, from};
  }
  return Share{};
}

// In an array with gaps (1,3,7), nobody does the shares of the gaps.
Result<Share> array_task_of(const Environment& environment) {
  const char* const kFrom = "SLURM_ARRAY_TASK_ID and SLURM_ARRAY_TASK_COUNT";
  if (environment("SLURM_ARRAY_TASK_ID") == nullptr) return Share{};
  const auto id = count_of(environment, "SLURM_ARRAY_TASK_ID");
  const auto count = count_of(environment, "SLURM_ARRAY_TASK_COUNT");
  if (!id || !count || *count < 1 || *count > kMostShares) return contradiction(kFrom);
  const auto first = count_of(environment, "SLURM_ARRAY_TASK_MIN");
  const auto last = count_of(environment, "SLURM_ARRAY_TASK_MAX");
  if (!first || !last) return Share{*id % *count, *count, kFrom};
  const std::size_t step = std::max<std::size_t>(1, count_of(environment, "SLURM_ARRAY_TASK_STEP").value_or(1));
  if (*id < *first || *id > *last || *last - *first >= kMostShares * step) return contradiction(kFrom);
  return Share{(*id - *first) / step, (*last - *first) / step + 1, kFrom};
}

constexpr std::string_view kHeader = "t_s,x_rad_s,y_rad_s,z_rad_s";
constexpr double kLastTime_s = 4e9;  // later than today's UTC

std::optional<GyroSample> sample_of(std::string_view line) {
  const auto row = numbers_of<4>(line);
  if (!row || (*row)[0] < 0.0 || (*row)[0] > kLastTime_s) return std::nullopt;
  const auto [t_s, x, y, z] = *row;
  const GyroSample sample{to_ns(t_s), {x, y, z}};
  return is_turn(sample.rate) ? std::optional(sample) : std::nullopt;
}

namespace fs = std::filesystem;

// `text`: a number, or "auto".
Status read_lambda(const std::string& text, deblur::Settings& settings) {
  settings.auto_lambda = text == "auto";
  if (settings.auto_lambda) return {};
  if (const auto lambda = bolo::number_of(text)) {
    settings.lambda = *lambda;
    return {};
  }
  return bad_input("--lambda '" + text + "': give a number of 0 or more, or auto");
}

// Computed before the file is read: outputs do not match a file that changes later. Its reader reports faults.
void note_sum(const char* name, const fs::path& file, DeblurRequest& request) {
  if (!request.into_folder || file.empty()) return;
  if (const auto sum = checksum_of_file(file)) request.sums[name] = *sum;
}

Status read_profile(const cxxopts::ParseResult& args, DeblurRequest& request) {
  if (args.count("profile") == 0) return {};
  request.profile_file = args["profile"].as<std::string>();
  note_sum("profile", request.profile_file, request);
  ASSIGN_OR_RETURN(const auto profile, model::read_profile(request.profile_file));
  request.maps_file = profile.maps;
  note_sum("maps", request.maps_file, request);
  ASSIGN_OR_RETURN(auto maps, capture::read_profile_maps(profile));
  pipeline::apply_profile(profile, std::move(maps), request.options);
  return {};
}

Status read_settings(const cxxopts::ParseResult& args, deblur::Settings& settings) {
  ASSIGN_OR_RETURN(settings.method, at("--solver", deblur::method_from_name(args["solver"].as<std::string>())));
  settings.iterations = args["iterations"].as<int>();
  settings.lookahead = args["lookahead"].as<int>();
  settings.window = args["window"].as<int>();
  settings.levels = args["levels"].as<int>();
  if (args.count("tau") != 0) settings.tau_s = args["tau"].as<double>();
  settings.kappa = args["kappa"].as<double>();
  settings.noise_k = args["noise"].as<double>();
  return read_lambda(args["lambda"].as<std::string>(), settings);
}

Status read_gyro_file(const cxxopts::ParseResult& args, DeblurRequest& request) {
  if (args.count("gyro") == 0) return {};
  request.gyro_file = args["gyro"].as<std::string>();
  if (const Status status = deblur::check_gyro(request.options.deblur); !status) return at("--gyro", status.error());
  note_sum("gyro", request.gyro_file, request);
  ASSIGN_OR_RETURN(auto samples, read_gyro(request.gyro_file));
  request.gyro = std::make_shared<const std::vector<GyroSample>>(std::move(samples));
  return {};
}

Result<PixelType> type_from_name(const std::string& name) {
  if (name == "float32") return PixelType::kFloat32;
  if (name == "uint16") return PixelType::kUint16;
  return bad_input("--type '" + name + "': give float32 or uint16");
}

Status read_pixels(const cxxopts::ParseResult& args, DeblurRequest& request) {
  if (args.count("roi") != 0) {
    const auto roi = args["roi"].as<std::vector<int>>();
    if (roi.size() != 4) return bad_input("--roi takes four numbers: x,y,width,height");
    request.options.region = Region{roi[0], roi[1], roi[2], roi[3]};
  }
  if (args.count("points") != 0) {
    if (request.options.region) return bad_input("--roi and --points: give one of them");
    request.points_file = args["points"].as<std::string>();
  }
  return {};
}

bool is_capture_name(const fs::path& file) { return file.extension() == ".h5" || file.extension() == ".mat"; }

// A folder stands for the captures in it, sorted by name.
Result<std::vector<fs::path>> captures_in(const fs::path& given) {
  std::error_code error;
  const fs::file_type type = fs::status(given, error).type();
  if (type != fs::file_type::directory && type != fs::file_type::none) return std::vector<fs::path>{given};
  std::vector<fs::path> captures;
  for (fs::directory_iterator at(given, error), end; !error && at != end; at.increment(error)) {
    std::error_code unknown;
    const fs::file_type kind = at->status(unknown).type();
    const bool fails = kind == fs::file_type::none && unknown != std::errc::too_many_symbolic_link_levels;
    const bool may_be_read = kind == fs::file_type::regular || fails;
    if (may_be_read && is_capture_name(at->path())) captures.push_back(at->path());
  }
  if (error) return bad_input(given.string() + ": cannot be read: " + error.message());
  if (captures.empty()) return bad_input(given.string() + ": no captures (.h5, .mat) in this folder");
  std::ranges::sort(captures);
  return captures;
}

// Several captures, or those of a folder, go into a folder under their own names.
Status name_outputs(std::vector<fs::path> inputs, DeblurRequest& request) {
  if (!request.into_folder) {
    request.files.push_back({std::move(inputs.front()), request.output});
    return {};
  }
  std::error_code error;
  const bool named_as_file = is_capture_name(request.output) || fs::exists(request.output, error);
  if (named_as_file && !fs::is_directory(request.output, error)) {
    return bad_input(request.output.string() + ": several captures need a folder, this is a file; give -o FOLDER");
  }
  std::set<fs::path> names;
  for (fs::path& input : inputs) {
    const fs::path output = request.output / input.filename().replace_extension(".h5");
    if (!names.insert(output).second) {
      return bad_input(input.string() + ": another capture would also become " + output.string() +
                       "; rename one, or deblur them into two folders");
    }
    request.files.push_back({std::move(input), output});
  }
  return {};
}

Status read_files(const cxxopts::ParseResult& args, DeblurRequest& request) {
  const std::vector<fs::path> given = files_of(args, "input");
  if (given.empty()) return bad_input("no capture given; usage: bolo deblur IN.h5 -o OUT.h5");
  if (args.count("output") == 0) return bad_input("no output given; add -o OUT.h5");
  request.output = args["output"].as<std::string>();
  std::vector<fs::path> inputs;
  std::error_code ignored;
  bool into_folder = given.size() > 1 || fs::is_directory(request.output, ignored);
  for (const fs::path& one : given) {
    ASSIGN_OR_RETURN(const auto captures, captures_in(one));
    into_folder = into_folder || captures.front() != one;
    inputs.insert(inputs.end(), captures.begin(), captures.end());
  }
  request.into_folder = into_folder;
  return name_outputs(std::move(inputs), request);
}

const char* variable(const char* name) { return std::getenv(name); }

// Existing files in a folder are checked when it is their turn.
Status check_files(DeblurRequest& request) {
  if (request.into_folder && request.share.count > 1) {
    RETURN_IF_ERROR(make_folder(request.output));  // for the other processes' shares, too
  } else if (request.into_folder) {
    ASSIGN_OR_RETURN(auto made, OutputFolder::make(request.output));
    request.folder.emplace(std::move(made));
  }
  std::vector<fs::path> outputs;
  std::vector<fs::path> inputs{request.points_file, request.profile_file, request.maps_file, request.gyro_file};
  for (const DeblurFile& file : request.files) {
    outputs.push_back(file.output);
    inputs.push_back(file.input);
  }
  return check_outputs(outputs, inputs, request.into_folder ? Replace::kExisting : request.replace);
}

}  // namespace

Result<Share> share_named(const std::string& text) {
  const std::size_t slash = text.find('/');
  const auto index = whole_number<std::size_t>(std::string_view(text).substr(0, slash));
  const auto count =
      slash == std::string::npos ? std::nullopt : whole_number<std::size_t>(std::string_view(text).substr(slash + 1));
  if (!index || !count || *count < 1 || *count > kMostShares || *index > *count) {
    return bad_input("--shard '" + text + "': give I/N, the I-th of N parts, counted from 0 or from 1");
  }
  return Share{*index % *count, *count, "--shard " + text};
}

Result<Share> share_of(const Environment& environment) {
  ASSIGN_OR_RETURN(auto rank, rank_of(environment));
  ASSIGN_OR_RETURN(auto task, array_task_of(environment));
  if (rank.count == 1) return task.count == 1 ? Share{} : task;
  const std::string from = task.count == 1 ? rank.from : rank.from + ", " + task.from;
  return Share{task.index * rank.count + rank.index, task.count * rank.count, from};
}

int threads_of(const Environment& environment, int processors) {
  if (const auto given = count_of(environment, "SLURM_CPUS_PER_TASK"); given && *given > 0) {
    return static_cast<int>(std::min<std::size_t>(*given, static_cast<std::size_t>(std::max(processors, 1))));
  }
  for (const char* name : {"OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS"}) {
    const auto ranks = count_of(environment, name);
    if (ranks && *ranks > 0)
      return std::max(1, processors / static_cast<int>(std::min<std::size_t>(*ranks, 1U << 20U)));
  }
  return std::max(1, processors);
}

Result<std::vector<GyroSample>> read_gyro(const std::filesystem::path& file) {
  std::vector<GyroSample> samples;
  RETURN_IF_ERROR(read_rows(file, [&samples](std::string_view line, bool first) -> Status {
    if (first && line == kHeader) return {};
    const auto sample = sample_of(line);
    if (!sample) {
      return bad_input(fmt::format("'{}' is no sample of a gyro; write {}, times from 0 s, rates up to {} rad/s",
                                   line.substr(0, 80), kHeader, kFastestTurn));
    }
    if (!samples.empty() && sample->time_ns <= samples.back().time_ns) {
      return bad_input("time does not rise from the line before");
    }
    samples.push_back(*sample);
    return {};
  }));
  if (samples.empty()) return bad_input(fmt::format("{}: no samples; write lines of {}", file.string(), kHeader));
  return samples;
}

std::int64_t GyroOfCapture::time_of(const FrameMeta& frame) const noexcept {
  const std::vector<double>& host = reader_->t_host();
  const std::vector<double>& t = reader_->t();
  if (host.size() != t.size()) return frame.camera_ns;
  const auto at = std::ranges::lower_bound(t, frame.camera_ns, {}, to_ns);
  return at == t.end() ? frame.camera_ns : to_ns(host[static_cast<std::size_t>(at - t.begin())]);
}

cxxopts::Options deblur_command_line() {
  const deblur::Settings defaults;
  const auto text = [](double value) { return fmt::format("{:g}", value); };
  cxxopts::Options options("bolo deblur",
                           "Undo the pixels' thermal inertia in captures.\n"
                           "Several captures go into a folder: finished ones are skipped, and processes can share the "
                           "work\n(--shard, or processes started by mpirun, srun or a Slurm array).");
  options.positional_help("IN.h5...");
  // clang-format off
  options.add_options()
    ("input", "Captures to read, or folders of them", cxxopts::value<std::vector<std::string>>())
    ("o,output", "Capture to write; of several captures, the folder for them", cxxopts::value<std::string>(), "OUT.h5")
    ("profile", "Camera profile: effects to undo", cxxopts::value<std::string>(), "P.toml")
    ("tau", "Thermal time constant, s (default: the profile's, else " + text(defaults.tau_s) + ")",
     cxxopts::value<double>(), "S")
    ("gyro", "Gyro rates for the solver motion: lines of t_s,x_rad_s,y_rad_s,z_rad_s",
     cxxopts::value<std::string>(), "G.csv")
    ("scene-nuc", "Learn and remove the fixed pattern that stays while the scene moves")
    ("solver", "admm, dual, exact, inverse, mmae or motion", cxxopts::value<std::string>()->default_value("admm"))
    ("iterations", "ADMM iterations; 0: as many as accuracy requires",
     cxxopts::value<int>()->default_value(text(defaults.iterations)), "I")
    ("kappa", "Weight of the data in kappa ||VA - Y||^2 + lambda ||D||_1",
     cxxopts::value<double>()->default_value(text(defaults.kappa)), "K")
    ("lambda", "Weight of sparsity, K (counts for a capture without kelvin), or auto: from noise and motion",
     cxxopts::value<std::string>()->default_value("auto"), "L")
    ("noise", "Temporal noise for --lambda auto, mmae and motion, K or counts like lambda; 0: measured",
     cxxopts::value<double>()->default_value(text(defaults.noise_k)), "N")
    ("lookahead", "Frames of the window after the estimated one",
     cxxopts::value<int>()->default_value(text(defaults.lookahead)), "L")
    ("window", "Frames in the window, 2^k + 1", cxxopts::value<int>()->default_value(text(defaults.window)), "N")
    ("levels", "Haar levels n: 2^n bins in the window",
     cxxopts::value<int>()->default_value(text(defaults.levels)), "N")
    ("threads", "Worker threads (default: one per processor, shared by the ranks of a host)", cxxopts::value<int>(), "W")
    ("isa", "Instruction set of the kernels, or auto: the best", cxxopts::value<std::string>()->default_value("auto"),
     "NAME")
    ("roi", "Only this part of the frame", cxxopts::value<std::vector<int>>(), "x,y,w,h")
    ("points", "Only these pixels: lines of x,y", cxxopts::value<std::string>(), "P.csv")
    ("type", "float32 (kelvin) or uint16 (the input's scale)",
     cxxopts::value<std::string>()->default_value("float32"))
    ("shard", "I-th of N shares of the captures (default: from the variables of mpirun, srun or a Slurm array)",
     cxxopts::value<std::string>(), "I/N")
    ("json", "Print the summary as JSON");
  add_overwrite_option(options);
  // clang-format on
  options.parse_positional({"input"});
  return options;
}

Result<DeblurRequest> read_deblur_request(const cxxopts::ParseResult& args) {
  DeblurRequest request;
  request.json = args.count("json") != 0;
  RETURN_IF_ERROR(read_files(args, request));
  RETURN_IF_ERROR(read_profile(args, request));
  RETURN_IF_ERROR(read_settings(args, request.options.deblur));
  RETURN_IF_ERROR(read_gyro_file(args, request));
  request.options.undo.scene_nuc |= args.count("scene-nuc") != 0;
  if (Status status = deblur::choose_isa(args["isa"].as<std::string>()); !status) return at("--isa", status.error());
  request.isa_given = args["isa"].as<std::string>() != "auto";
  ASSIGN_OR_RETURN(request.options.output, type_from_name(args["type"].as<std::string>()));
  const int processors = static_cast<int>(std::thread::hardware_concurrency());
  request.options.workers = threads_of(variable, processors);
  if (args.count("threads") != 0) {
    ASSIGN_OR_RETURN(request.options.workers, number_of<int>(args, "threads", 1, pipeline::kMaxWorkers));
  }
  RETURN_IF_ERROR(read_pixels(args, request));
  const bool named = args.count("shard") != 0;
  ASSIGN_OR_RETURN(request.share, named ? share_named(args["shard"].as<std::string>()) : share_of(variable));
  request.replace = replace_of(args);
  RETURN_IF_ERROR(check_files(request));
  return request;
}

Status check_capture(const DeblurRequest& request, const fs::path& file, const capture::CaptureInfo& info) {
  deblur::Settings settings = request.options.deblur;
  if (Status status = deblur::validate(settings); !status) return status;
  settings.period_s = info.format.frame_period_s;
  if (Status status = deblur::validate(settings); !status) {
    const bool looks_like_ms = settings.period_s > 10.0 && settings.period_s < 1e4;
    const char* const hint = looks_like_ms ? "; if it is milliseconds, divide /t and frame_period_s by 1000" : "";
    return at(file.string(), Error{status.error().kind, status.error().message + hint});
  }
  if (info.frames < static_cast<std::size_t>(settings.window)) {
    return bad_input(fmt::format("{}: {} frames, fewer than one window of {}; record longer or give a smaller --window",
                                 file.string(), info.frames, settings.window));
  }
  if (request.options.output == PixelType::kUint16 && info.format.type != PixelType::kUint16) {
    return bad_input(file.string() + ": /frames is float32, which has no uint16 scale; use --type float32");
  }
  return {};
}

Result<std::vector<std::uint32_t>> points_of(const DeblurRequest& request, Geometry frame) {
  if (request.points_file.empty()) return std::vector<std::uint32_t>{};
  return read_points(request.points_file, frame);
}

std::vector<std::pair<std::string, std::string>> files_behind(const DeblurRequest& request) {
  std::vector<std::pair<std::string, std::string>> names;
  if (!request.points_file.empty()) names.emplace_back("points_file", request.points_file.filename().string());
  if (!request.profile_file.empty()) names.emplace_back("profile", request.profile_file.filename().string());
  if (!request.maps_file.empty()) names.emplace_back("maps", request.maps_file.filename().string());
  if (!request.gyro_file.empty()) names.emplace_back("gyro", request.gyro_file.filename().string());
  return names;
}

}  // namespace bolo::tools
