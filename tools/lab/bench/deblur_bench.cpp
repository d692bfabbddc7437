// `bolo-lab bench`: time and accuracy of each way to deblur a 640x120 frame, in one run on one input.
#include <algorithm>
#include <array>
#include <cstring>
#include <map>

#include "src/corrections/pixel_correction.hpp"
#include "src/deblur/isa.hpp"
#include "src/deblur/solver.hpp"
#include "tools/lab/bench/bench.hpp"
#include "tools/lab/recording.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

using Clock = std::chrono::steady_clock;

constexpr Geometry kFrame{640, 120};
constexpr double kSpeed = 300.0;  // px/s
constexpr int kExactRows = 4;
constexpr double kLambdas[] = {0.5, 0.05, 0.005};  // lambda_half, K
constexpr int kFewestRepeats = 3;
constexpr double kRowDelay_s = 2e-5;
constexpr std::size_t kMostLost = 2;

using Planes = std::vector<const void*>;

deblur::WindowView window_of(const Planes& planes) { return {planes, static_cast<int>(planes.size()) - 1}; }

// The newest window of a street that passes the camera, with 30 mK of noise, 10 mK per count.
struct Input {
  StreamFormat format;
  std::vector<std::vector<std::uint16_t>> frames;
  std::array<Planes, kMostLost + 1> without;  // by number of frames lost: every other one before the newest
};

Result<Input> make_input(const deblur::Settings& settings) {
  sim::CameraSettings camera;
  camera.geometry = kFrame;
  const StreetPass pass{
      .street = 1, .speed_px_s = kSpeed, .frames = static_cast<std::size_t>(settings.window), .more_frames = 0};
  ASSIGN_OR_RETURN(const auto street, record_street(camera, pass));
  Input input;
  input.format = street.format;
  for (const auto& bytes : street.planes) {
    input.frames.emplace_back(kFrame.pixels());
    std::memcpy(input.frames.back().data(), bytes.data(), bytes.size());
  }
  for (std::size_t lost = 0; lost <= kMostLost; ++lost) {
    Planes& planes = input.without[lost];
    for (const auto& frame : input.frames) planes.push_back(frame.data());
    for (std::size_t k = 1; k <= lost; ++k) planes[planes.size() - 1 - 2 * k] = nullptr;
  }
  return input;
}

// A complete camera profile that changes no value, so that errors can be measured; the work is the same for any values.
// One pixel of 200 is dead, outside the compared rows.
model::PixelMaps neutral_maps(const deblur::Settings& settings) {
  model::PixelMaps maps;
  maps.tau_s.assign(kFrame.pixels(), static_cast<float>(settings.tau_s));
  maps.gain.assign(kFrame.pixels(), 1.0F);
  maps.offset.assign(kFrame.pixels(), 0.0F);
  maps.dead.assign(kFrame.pixels(), 0);
  for (std::size_t i = std::size_t{2} * kExactRows * static_cast<std::size_t>(kFrame.width); i < maps.dead.size();
       i += 200) {
    maps.dead[i] = 1;
  }
  return maps;
}

// A profile's work per frame: the newest one is converted to float and corrected.
class Corrected {
 public:
  Corrected(const Input& input, corrections::PixelCorrection correction)
      : raw_(input.frames.back()), correction_(std::move(correction)) {
    for (const auto& frame : input.frames) frames_.emplace_back(frame.begin(), frame.end());
    for (const auto& frame : frames_) planes_.push_back(frame.data());
  }
  void begin() noexcept { correction_.begin(1); }
  void correct(int first_row, int end_row) noexcept {
    const PixelRange pixels{Geometry{kFrame.width, first_row}.pixels(), Geometry{kFrame.width, end_row}.pixels()};
    float* const to = frames_.back().data();
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) to[i] = static_cast<float>(raw_[i]);
    correction_.apply(to, pixels);
  }
  void finish() noexcept { correction_.finish(frames_.back().data()); }
  deblur::WindowView window() const { return window_of(planes_); }

 private:
  const std::vector<std::uint16_t>& raw_;
  corrections::PixelCorrection correction_;
  std::vector<std::vector<float>> frames_;
  Planes planes_;
};

struct Variant {
  std::string solver;  // as in --solver
  std::string isa;     // empty: the best
  int threads = 1;
  double lambda_half_k = 0.0;
  int lost = 0;          // missing frames before the newest
  bool profile = false;  // with maps of gain, offset, time constant and dead pixels, and a row delay
};

// A variant under measurement.
class Runner {
 public:
  // `corrected`: input of variants with a profile; all share it, as the others share one window.
  Runner(const Input& input, Corrected& corrected, Variant what)
      : input_(input), corrected_(corrected), what_(std::move(what)), out_(kFrame.pixels()) {
    settings_.method = *deblur::method_from_name(what_.solver);
    settings_.lambda = what_.lambda_half_k * 2.0 * settings_.kappa;
  }

  Status open() {
    if (!deblur::force_isa(what_.isa)) return bad_input("--isa " + what_.isa + ": not available here");
    rows_ = what_.solver == "exact" ? kExactRows : kFrame.height;
    StreamFormat format = input_.format;
    if (what_.profile) format.type = PixelType::kFloat32;
    const double row_delay_s = what_.profile ? kRowDelay_s : 0.0;
    ASSIGN_OR_RETURN(solver_, deblur::Solver::create(settings_, format, PixelType::kFloat32, row_delay_s));
    solver_->prepare(window());
    what_.isa = solver_->isa();
    team_ = std::make_unique<rt::WorkerTeam>(what_.threads, rt::ThreadOptions{"bolo-bench"});
    if (team_->size() < what_.threads) return failed("cannot start " + std::to_string(what_.threads) + " threads");
    return {};
  }

  void measure() {
    const auto start = Clock::now();
    if (what_.profile) {
      corrected_.begin();
      for_parts(*team_, kFrame.height, [this](int begin, int end) { corrected_.correct(begin, end); });
      corrected_.finish();
    }
    for_parts(*team_, rows_, [this](int begin, int end) {
      solver_->solve(window(), {0, begin, kFrame.width, end - begin}, out_.data());
    });
    const double ms = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
    times_.push_back(ms * kFrame.height / rows_);
  }

  // Times of the fastest repeat for a whole frame; errors against the optimum, over the first pixels. `scaling`: time
  // on one thread over this; `throughput_of_plain`: frame rate over that without profile or losses, or 1.
  Json result(const std::vector<float>& exact) {
    std::ranges::sort(times_);
    const auto pixels = static_cast<std::size_t>(rows_ * kFrame.width);
    SquareSum errors;
    double most = 0.0;
    for (std::size_t i = 0; i < std::min(exact.size(), pixels); ++i) {
      errors.add(out_[i], exact[i]);
      most = std::max(most, std::abs(static_cast<double>(out_[i]) - static_cast<double>(exact[i])));
    }
    return {{"solver", what_.solver},
            {"isa", what_.isa},
            {"threads", what_.threads},
            {"profile", what_.profile},
            {"lost_frames", what_.lost},
            {"iterations", solver_->iterations()},
            {"lambda_half", what_.lambda_half_k},
            {"pixels", pixels},
            {"repeats", times_.size()},
            {"ms_per_frame", times_.front()},
            {"median_ms_per_frame", times_[times_.size() / 2]},
            {"ns_per_pixel", 1e6 * times_.front() / static_cast<double>(kFrame.pixels())},
            {"rms_error_k", errors.root_mean()},
            {"max_error_k", most},
            {"realtime_factor", 1e3 * settings_.period_s / times_.front()},
            {"scaling", 1.0},
            {"throughput_of_plain", 1.0}};
  }

  const std::vector<float>& out() const { return out_; }

 private:
  deblur::WindowView window() const {
    return what_.profile ? corrected_.window() : window_of(input_.without[static_cast<std::size_t>(what_.lost)]);
  }

  const Input& input_;
  Corrected& corrected_;
  deblur::Settings settings_;
  Variant what_;
  int rows_ = 0;
  std::unique_ptr<deblur::Solver> solver_;
  std::unique_ptr<rt::WorkerTeam> team_;
  std::vector<float> out_;
  std::vector<double> times_;
};

struct BenchOptions {
  std::string solver = "admm";
  std::string isa;       // empty: the best
  int threads = 1;       // of the main figures
  double lambda = -1.0;  // for kappa 0.1; negative: the default
  double seconds = 5.0;  // measuring time; every variant is measured at least three times
};

// The main variant first. Plain scalar code is far slower than all others, so one variant of it is enough.
std::vector<Variant> list_variants(const BenchOptions& options, double lambda_half_k, int processors) {
  std::vector<Variant> list{{options.solver, options.isa, options.threads, lambda_half_k}};
  std::vector<std::string> isas{options.isa};
  const auto all = deblur::available_isas();
  if (options.isa.empty()) isas.assign(all.begin(), all.end());
  for (const char* solver : {"admm", "dual"}) {
    for (const std::string& isa : isas) {
      const bool slow = isa == "scalar" && isas.size() > 1;
      for (int threads = 1; threads <= std::min(2, processors); ++threads) {
        for (const double lambda : kLambdas) {
          for (int lost = 0; !slow && lost <= static_cast<int>(kMostLost); ++lost) {
            list.push_back({solver, isa, threads, lambda, lost});
          }
          if (threads == 1 && isa == isas.front()) list.push_back({solver, isa, 1, lambda, 0, true});
        }
      }
      if (slow) list.push_back({solver, isa, 1, kLambdas[0]});
    }
  }
  list.push_back({"inverse", options.isa});
  for (const double lambda : kLambdas) list.push_back({"exact", "", 1, lambda});
  return list;
}

Status check(const BenchOptions& options) {
  ASSIGN_OR_RETURN(const deblur::Method method, deblur::method_from_name(options.solver));
  // These solvers use state from frame to frame, and do not approach the optimum of a window.
  if (method == deblur::Method::kMmae || method == deblur::Method::kMotion) {
    return bad_input("--solver " + options.solver +
                     ": give admm, dual, exact or inverse, whose windows stand alone; bolo bench measures " +
                     options.solver);
  }
  if (options.threads < 1 || options.threads > 256) return bad_input("--threads: expected 1 to 256");
  if (!(options.seconds > 0.0 && options.seconds <= 3600.0)) return bad_input("--seconds: expected above 0, to 3600");
  const auto isas = deblur::available_isas();
  if (!options.isa.empty() && std::find(isas.begin(), isas.end(), options.isa) == isas.end()) {
    return bad_input("--isa " + options.isa + ": this program and processor have " +
                     joined({isas.begin(), isas.end()}));
  }
  return {};
}

// The optimum of the first rows, by lambda and number of lost frames.
using Optima = std::map<std::pair<double, int>, std::vector<float>>;
Result<Optima> optima(const Input& input, Corrected& corrected, const std::vector<Variant>& list) {
  Optima result;
  for (const Variant& what : list) {
    std::vector<float>& rows = result[{what.lambda_half_k, what.lost}];
    if (!rows.empty()) continue;
    Runner exact(input, corrected, {"exact", "", 1, what.lambda_half_k, what.lost});
    RETURN_IF_ERROR(exact.open());
    exact.measure();
    rows = exact.out();
    rows.resize(static_cast<std::size_t>(kExactRows * kFrame.width));
  }
  return result;
}

void compare_with_others(std::vector<Json>& results) {
  const auto alike = [](const Json& a, const Json& b, std::initializer_list<const char*> keys) {
    return std::ranges::all_of(keys, [&](const char* key) { return a[key] == b[key]; });
  };
  for (Json& result : results) {
    for (const Json& other : results) {
      if (!alike(result, other, {"solver", "isa", "lambda_half"})) continue;
      const double faster = other["ms_per_frame"].get<double>() / result["ms_per_frame"].get<double>();
      if (other["threads"] == 1 && alike(result, other, {"profile", "lost_frames"})) result["scaling"] = faster;
      const bool plain = other["profile"] == false && other["lost_frames"] == 0;
      if (plain && alike(result, other, {"threads"})) result["throughput_of_plain"] = faster;
    }
  }
}

// The main figures, and in "variants" all others under the same keys. kBadInput for an unknown solver, instruction set
// or number of threads. Changes force_isa() while it runs.
Result<Json> bench_deblur(const BenchOptions& options) {
  RETURN_IF_ERROR(check(options));
  deblur::Settings defaults;
  if (options.lambda >= 0.0) defaults.lambda = options.lambda;
  RETURN_IF_ERROR(deblur::validate(defaults));
  const int processors = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  ASSIGN_OR_RETURN(const auto input, make_input(defaults));
  const auto list = list_variants(options, defaults.half_square_lambda(), processors);
  ASSIGN_OR_RETURN(auto correction,
                   corrections::PixelCorrection::create(defaults, input.format, neutral_maps(defaults)));
  Corrected corrected(input, std::move(correction));
  ASSIGN_OR_RETURN(const auto exact, optima(input, corrected, list));

  std::vector<std::unique_ptr<Runner>> runners;
  for (const Variant& what : list) {
    runners.push_back(std::make_unique<Runner>(input, corrected, what));
    const Status opened = runners.back()->open();
    deblur::force_isa("");
    RETURN_IF_ERROR(opened);
  }
  const auto end = Clock::now() + std::chrono::duration<double>(options.seconds);
  for (int repeat = 0; repeat < kFewestRepeats || Clock::now() < end; ++repeat) {
    for (const auto& runner : runners) runner->measure();
  }
  std::vector<Json> results;
  for (std::size_t i = 0; i < list.size(); ++i) {
    results.push_back(runners[i]->result(exact.at({list[i].lambda_half_k, list[i].lost})));
  }
  compare_with_others(results);
  Json report = results.front();
  report["machine"] = {{"processors", processors}};
  report["variants"] = std::vector(results.begin() + 1, results.end());
  return report;
}

Status run_bench(const cxxopts::ParseResult& given) {
  const std::string what = given.count("what") != 0 ? given["what"].as<std::string>() : "";
  const auto seconds = [&given](double standard) {
    return given.count("seconds") != 0 ? given["seconds"].as<double>() : standard;
  };
  if (what != "deblur" && what != "readers") {
    return bad_input("expected what to measure: bolo-lab bench deblur or bolo-lab bench readers");
  }
  Json report;
  if (what == "deblur") {
    BenchOptions options{given["solver"].as<std::string>(), "", given["threads"].as<int>(), -1.0, seconds(5.0)};
    if (given.count("isa") != 0) options.isa = given["isa"].as<std::string>();
    if (given.count("lambda") != 0) options.lambda = given["lambda"].as<double>();
    if (given.count("lambda") != 0 && !(options.lambda >= 0.0)) return bad_input("--lambda: expected 0 or more");
    ASSIGN_OR_RETURN(report, bench_deblur(options));
  } else {
    ASSIGN_OR_RETURN(const int priority, number_of<int>(given, "priority", 0, 99));
    ASSIGN_OR_RETURN(report, bench_readers(seconds(40.0), priority));
  }
  print_report(report, given.count("json") != 0);
  return {};
}

}  // namespace

int lab_bench_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo-lab bench",
      "Measures on this machine, with 640x120 frames: deblur, the deblurring of one; readers, what\n"
      "processes that read shared memory cost the writer of 200 frames a second.\n"
      "deblur: a window of 17 frames of a street at 300 px/s, 30 mK of noise. The repeats of all variants\n"
      "take turns; errors are against exact on 2560 pixels, on which alone exact is timed. profile: with\n"
      "maps of gain, offset, time constant and dead pixels (0.5 %), and a row delay. lost_frames: every\n"
      "other one before the newest, those that cost the most. throughput_of_plain: frames a second, of\n"
      "those without both.\n");
  cli.positional_help("deblur|readers");
  add_option<std::string>(cli, "what", "deblur or readers");
  add_option<std::string>(cli, "solver", "admm, dual, exact or inverse: of the main figures", "admm");
  add_option<std::string>(cli, "isa", "Instruction set: AVX3 (AVX-512), AVX2, SSE4, SSE2 ... (default: the best)");
  add_option<int>(cli, "threads", "Of the main figures", "1");
  add_option<double>(cli, "lambda", "Of the main figures, kappa 0.1 (default: the solver's default)");
  add_option<double>(cli, "seconds", "How long to measure (default: deblur 5, readers 40)");
  add_option<int>(cli, "priority", "SCHED_FIFO priority of the writer with readers; 0: the default scheduler", "10");
  add_option<bool>(cli, "json", "Print the result as JSON");
  cli.parse_positional({"what"});
  return run_verb("bench", std::move(cli), argc, argv, run_bench, false);
}

}  // namespace bolo::tools
