// `bolo bench`: speed of each solver on this computer, relative to its camera.
#include <chrono>
#include <cstdio>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "src/core/statistics.hpp"
#include "src/deblur/solver.hpp"
#include "src/rt/thread.hpp"
#include "src/sim/simulator.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using Clock = std::chrono::steady_clock;

constexpr Geometry kFrame{640, 120};
constexpr deblur::Method kMethods[] = {deblur::Method::kAdmm, deblur::Method::kDual, deblur::Method::kMmae,
                                       deblur::Method::kMotion, deblur::Method::kInverse};
constexpr double kSpeed_px_s = 300.0;

constexpr int kFrames = 64;  // the window runs over them to the end and back

struct Stream {
  StreamFormat format;
  std::vector<std::vector<std::uint16_t>> frames;
};

// A street panning past the nominal camera.
Result<Stream> make_stream(int frames) {
  sim::CameraSettings camera;
  camera.geometry = kFrame;
  const double from_s = -sim::history_s(camera);
  const double to_s = frames * deblur::Settings{}.period_s;
  const auto scene = sim::make_street(kFrame, 1);
  const sim::Path path = sim::steady_pan(kSpeed_px_s);
  ASSIGN_OR_RETURN(auto field, sim::pan_over(*scene, path, sim::centred_origin(*scene, path, kFrame, from_s, to_s),
                                             kFrame, from_s, to_s));
  ASSIGN_OR_RETURN(const auto simulator, sim::Simulator::create(camera, std::move(field)));
  Stream stream{simulator->format(), {}};
  for (int i = 0; i < frames; ++i) {
    stream.frames.emplace_back(kFrame.pixels());
    simulator->next(stream.frames.back().data(), nullptr);
  }
  return stream;
}

// Median time per frame, ms.
Result<double> measure(const Stream& input, deblur::Method method, int threads, double seconds) {
  deblur::Settings settings;
  settings.method = method;
  settings.auto_lambda = method == deblur::Method::kAdmm || method == deblur::Method::kDual;
  ASSIGN_OR_RETURN(auto solver, deblur::Solver::create(settings, input.format, PixelType::kUint16));
  rt::WorkerTeam team(threads, rt::ThreadOptions{"bolo-bench"});
  if (team.size() < threads) return failed("cannot start " + std::to_string(threads) + " threads");
  std::vector<const void*> planes;
  for (const auto& frame : input.frames) planes.push_back(frame.data());
  for (std::size_t i = planes.size() - 2; i > 0; --i) planes.push_back(planes[i]);
  const auto length = static_cast<std::size_t>(settings.window);
  const std::size_t period = planes.size();
  for (std::size_t i = 0; i < length; ++i) planes.push_back(planes[i]);
  std::vector<std::uint16_t> out(kFrame.pixels());
  std::vector<double> ms;
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  for (std::uint64_t newest = 1; ms.size() < 5 || Clock::now() < end; ++newest) {
    const std::span<const void* const> all(planes);
    const deblur::WindowView window{all.subspan(newest % period, length), settings.window - 1, newest};
    const auto start = Clock::now();
    solver->prepare(window, team);
    for_parts(team, kFrame.height, [&](int first, int last) {
      solver->solve(window, {0, first, kFrame.width, last - first}, out.data());
    });
    ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
  }
  return median(std::move(ms));
}

Status bench(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const int threads, number_of<int>(given, "threads", 1, 256));
  const auto seconds = given["seconds"].as<double>();
  if (!(seconds > 0.0 && seconds <= 3600.0)) return bad_input("--seconds: expected more than 0, at most 3600");
  nlohmann::ordered_json result{
      {"width", kFrame.width}, {"height", kFrame.height}, {"rate_hz", 200}, {"threads", threads}};
  ASSIGN_OR_RETURN(const auto stream, make_stream(kFrames));
  std::string line;
  for (const deblur::Method method : kMethods) {
    ASSIGN_OR_RETURN(const double ms,
                     measure(stream, method, threads, seconds / static_cast<double>(std::size(kMethods))));
    const double factor = 1e3 * deblur::Settings{}.period_s / ms;
    const std::string_view solver = deblur::name(method);
    result["solvers"].push_back({{"solver", solver}, {"ms_per_frame", ms}, {"realtime_factor", factor}});
    line += fmt::format("{}{} {:.1f}", line.empty() ? "" : ", ", solver, factor);
  }
  if (given.count("json") != 0) {
    std::puts(result.dump(2).c_str());
  } else {
    std::printf("a street at 640x120 and 200 Hz, %d thread%s; times faster than the camera: %s\n", threads,
                threads == 1 ? "" : "s", line.c_str());
  }
  return {};
}

}  // namespace

int bench_main(int argc, char** argv) {
  cxxopts::Options options("bolo bench",
                           "Measure how many times faster than the camera (640x120, 200 Hz) each solver runs here.");
  add_option<int>(options, "threads", "Worker threads", "1", "N");
  add_option<double>(options, "seconds", "Duration of the measurement", "2", "S");
  add_option<bool>(options, "json", "Print the result as JSON");
  return run_verb("bench", std::move(options), argc, argv, bench, false);
}

}  // namespace bolo::tools
