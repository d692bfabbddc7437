#include <algorithm>
#include <mutex>
#include <numeric>
#include <random>

#include "src/core/clock.hpp"
#include "src/deblur/window.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr double kWrongSpeed = 1.1;

Geometry judged_size(const Sequence& s) { return {s.clean->judged.width, s.clean->judged.height}; }

// A column's figures; `setting`: what was picked, or measured.
Json figures_of(const Planes& planes, const Planes& truth, const Sequence& s, const std::string& setting = "") {
  Json figures = measure(planes, truth, judged_size(s));
  if (!setting.empty()) figures["setting"] = setting;
  return figures;
}

// What a row of a table is of.
Json place_of(const Sequence& s) {
  return {{"scene", s.clean->task.scene}, {"motion", s.clean->task.motion.label()}, {"noise_k", s.noise_k}};
}

// A solver for the sequence's stream, kelvin out; one is made at a time.
Result<std::unique_ptr<deblur::Solver>> make_solver(const Sequence& s, const deblur::Settings& settings) {
  static std::mutex one_at_a_time;  // set-up is no place for two threads
  const std::lock_guard lock(one_at_a_time);
  return deblur::Solver::create(settings, s.format, PixelType::kFloat32);
}

// Settings of a column that a stream can run live; kBadInput says why this build has none. `auto`, `mmae` and `motion`
// work from the measured noise, so that a solver which does not measure it is not the one asked for.
Result<deblur::Settings> live_settings(std::string_view column, const Sequence& s, int lookahead) {
  if (column == "inverse") return settings_of(deblur::Method::kInverse, lookahead);
  const auto* const asked = std::ranges::find(kColumns, column, &Column::name);
  deblur::Settings settings = settings_of(asked->live.value_or(deblur::Method::kAdmm), lookahead);
  settings.auto_lambda = column == "auto";
  ASSIGN_OR_RETURN(const auto solver, make_solver(s, settings));
  const auto planes = s.window_ending_at(kWindow - 1);
  solver->prepare({planes, kWindow - 1 - lookahead});
  if (solver->noise_k() > 0.0) return settings;
  return bad_input("this build's solver does not measure the noise");
}

Planes blurred(const Sequence& s) {
  Planes planes;
  for (const std::size_t k : s.clean->targets) planes.push_back(cut(s.kelvin(k), s.clean->geometry, s.clean->judged));
  return planes;
}

// The trail at each target for its velocity times a factor.
std::vector<std::vector<Tap>> motion_kernels(const CleanSequence& clean, double factor) {
  std::vector<std::vector<Tap>> kernels;
  for (const sim::Position v : clean.content_v) {
    kernels.push_back(motion_kernel({factor * v.x_px, factor * v.y_px}, kTauS));
  }
  return kernels;
}

// The QP at every lambda of the grid.
Status add_qp(const Sequence& s, const Planes& truth, int lookahead, Json& cell) {
  Oracle oracle(truth);
  for (const double lambda : kLambdas) {
    ASSIGN_OR_RETURN(auto planes, estimate(s, settings_of(deblur::Method::kAdmm, lookahead, lambda)));
    if (lambda == kAuthorsLambda) cell["columns"]["qp_authors"] = figures_of(planes, truth, s);
    const double error = oracle.offer(std::move(planes), plot::format("lambda %g", lambda));
    cell["qp_grid"].push_back({{"lambda", lambda}, {"rmse_k", error}});
  }
  cell["columns"]["qp_best"] = figures_of(oracle.best().planes, truth, s, oracle.best().setting);
  return {};
}

Json live_column(const Sequence& s, const Planes& truth, std::string_view column, int lookahead) {
  double noise_k = 0.0;
  const auto planes = live_settings(column, s, lookahead).and_then([&](const deblur::Settings& settings) {
    return estimate(s, settings, &noise_k);
  });
  if (!planes) return {{"skipped", planes.error().message}};
  return figures_of(*planes, truth, s, plot::format("noise measured %.3f K", noise_k));
}

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double live_rmse(const Sequence& s, const Planes& truth, std::string_view column, int lookahead) {
  if (column == "qp_best") {
    double best = kNone;
    for (const double lambda : kLambdas) {
      const auto planes = estimate(s, settings_of(deblur::Method::kAdmm, lookahead, lambda));
      if (!planes) return kNone;
      best = std::fmin(best, rmse(*planes, truth));
    }
    return best;
  }
  const auto planes =
      live_settings(column, s, lookahead).and_then([&](const deblur::Settings& good) { return estimate(s, good); });
  return planes ? rmse(*planes, truth) : kNone;
}

constexpr double kDefaultLambda = deblur::Settings{}.lambda;

// Solves a stream as the pipeline does. `numbers` are the frames that arrive; with `closed_up` their counters and times
// hide what was lost. Mean squared error of each frame, K^2; NaN where there is no full window.
Result<std::vector<double>> stream_errors(const Sequence& s, const deblur::Settings& settings,
                                          const std::vector<std::size_t>& numbers, bool closed_up) {
  ASSIGN_OR_RETURN(const auto solver, make_solver(s, settings));
  const CleanSequence& clean = *s.clean;
  deblur::Window window(settings);
  deblur::Window::Ready ready;
  Plane whole(clean.geometry.pixels());
  std::vector<double> errors(s.frames.size(), kNone);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::size_t place = closed_up ? i : numbers[i];
    deblur::WindowFrame frame;
    frame.meta.frame_id = place;
    frame.meta.camera_ns = to_ns(static_cast<double>(place) * kPeriodS);
    frame.plane = s.frames[numbers[i]].data();
    frame.token = static_cast<std::uint32_t>(numbers[i]);
    window.push(frame, false);
    while (window.next(ready)) {
      if (!ready.full) continue;
      solver->prepare(ready.view);
      solver->solve(ready.view, clean.judged, whole.data());
      SquareSum error;
      const Plane judged = cut(whole, clean.geometry, clean.judged);
      for (std::size_t p = 0; p < judged.size(); ++p) error.add(judged[p], clean.truth[ready.frame.token][p]);
      errors[ready.frame.token] = error.mean();
    }
  }
  return errors;
}

// Root of the mean over frames: of the whole stream, and of that with losses, which are noticed, or not.
struct Sums {
  std::array<double, 3> sum{};
  int frames = 0;

  void add(const std::array<double, 3>& errors) {
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += errors[i];
    ++frames;
  }
  Json errors() const {
    const auto rms = [this](std::size_t i) { return frames > 0 ? std::sqrt(sum[i] / frames) : kNone; };
    return {{"frames", frames}, {"whole_rmse_k", rms(0)}, {"gap_aware_rmse_k", rms(1)}, {"gap_blind_rmse_k", rms(2)}};
  }
};

bool near_loss(const std::vector<bool>& lost, std::size_t k) {
  const std::size_t from = k > kNearLoss ? k - kNearLoss : 0;
  for (std::size_t i = from; i <= std::min(k + kNearLoss, lost.size() - 1); ++i) {
    if (lost[i]) return true;
  }
  return false;
}

Result<Json> drop_figures(const Sequence& s, const deblur::Settings& settings, const std::vector<bool>& lost) {
  std::vector<std::size_t> all(s.frames.size());
  std::iota(all.begin(), all.end(), 0U);
  std::vector<std::size_t> arrived;
  std::ranges::copy_if(all, std::back_inserter(arrived), [&](std::size_t k) { return !lost[k]; });
  ASSIGN_OR_RETURN(const auto whole, stream_errors(s, settings, all, false));
  ASSIGN_OR_RETURN(const auto aware, stream_errors(s, settings, arrived, false));
  ASSIGN_OR_RETURN(const auto blind, stream_errors(s, settings, arrived, true));
  Sums every;
  Sums near;
  for (std::size_t k = kLeadIn; k < all.size(); ++k) {
    const std::array errors{whole[k], aware[k], blind[k]};
    if (std::ranges::any_of(errors, [](double e) { return std::isnan(e); })) continue;
    every.add(errors);
    if (near_loss(lost, k)) near.add(errors);
  }
  return Json{{"frames_lost", std::ranges::count(lost, true)}, {"all", every.errors()}, {"near", near.errors()}};
}

}  // namespace

deblur::Settings settings_of(deblur::Method method, int lookahead, double lambda) {
  deblur::Settings settings;
  settings.method = method;
  settings.tau_s = kTauS;
  settings.period_s = kPeriodS;
  settings.window = kWindow;
  settings.lambda = lambda;
  settings.lookahead = lookahead;
  return settings;
}

Result<Planes> estimate(const Sequence& s, const deblur::Settings& settings, double* noise_k) {
  ASSIGN_OR_RETURN(const auto solver, make_solver(s, settings));
  const CleanSequence& clean = *s.clean;
  const auto lookahead = static_cast<std::size_t>(settings.lookahead);
  Planes out;
  Plane whole(clean.geometry.pixels());
  auto next = clean.targets.begin();
  for (std::size_t k = kWindow - 1; next != clean.targets.end(); ++k) {
    const auto planes = s.window_ending_at(k + lookahead);
    const deblur::WindowView window{planes, kWindow - 1 - settings.lookahead, k + lookahead + 1};
    solver->prepare(window);
    if (k != *next) continue;
    solver->solve(window, clean.judged, whole.data());
    out.push_back(cut(whole, clean.geometry, clean.judged));
    ++next;
  }
  if (noise_k != nullptr) *noise_k = solver->noise_k();
  return out;
}

Json spatial_columns(const Sequence& s) {
  const Planes truth = target_truth(*s.clean);
  Planes frames;
  for (const std::size_t target : s.clean->targets) frames.push_back(s.kelvin(target));
  const auto told = motion_kernels(*s.clean, 1.0);
  const auto told_wrongly = motion_kernels(*s.clean, kWrongSpeed);
  const SpatialTask task{s, truth, frames, told};
  const auto shown = [&](const Picked& picked) { return figures_of(picked.planes, truth, s, picked.setting); };
  return {{"unsharp", shown(picked_unsharp(s, truth, frames))},
          {"spatial_wiener", shown(picked_wiener(task))},
          {"spatial_wiener_10", shown(picked_wiener({s, truth, frames, told_wrongly}))},
          {"richardson_lucy", shown(picked_lucy(task))}};
}

Result<Json> evaluate(const Sequence& s, const Sequence& training, int lookahead) {
  const Planes truth = target_truth(*s.clean);
  const Motion& motion = s.clean->task.motion;
  Json cell = place_of(s);
  cell["speed_px_s"] = motion.is_pan() ? Json(motion.speed_px_s) : Json();
  cell["trajectory"] = motion.is_pan() ? Json() : Json(motion.trajectory.string());
  cell["lookahead"] = lookahead;
  cell["truth_edge_width_px"] = edge_width(truth, truth, judged_size(s));
  cell["columns"]["blurred"] = figures_of(blurred(s), truth, s);
  ASSIGN_OR_RETURN(const auto inverse, estimate(s, settings_of(deblur::Method::kInverse, lookahead)));
  cell["columns"]["inverse"] = figures_of(inverse, truth, s);
  RETURN_IF_ERROR(add_qp(s, truth, lookahead, cell));
  for (const Column& column : kColumns) {
    if (column.live) cell["columns"][column.name] = live_column(s, truth, column.name, lookahead);
  }
  cell["columns"]["temporal_wiener"] = figures_of(TemporalWiener(training, lookahead).apply(s), truth, s);
  return cell;
}

Json latency_curves(const Sequence& s, int longest) {
  const Planes truth = target_truth(*s.clean);
  Json curves = place_of(s);
  curves["blurred_rmse_k"] = rmse(blurred(s), truth);
  for (int lookahead = 0; lookahead <= longest; ++lookahead) {
    curves["lookaheads"].push_back(lookahead);
    for (const char* column : kLiveColumns) curves[column].push_back(live_rmse(s, truth, column, lookahead));
  }
  return curves;
}

std::vector<bool> losses(std::size_t frames, double share, std::uint64_t seed) {
  constexpr std::size_t kTail = 2;
  std::vector<bool> lost(frames, false);
  if (frames <= kLeadIn + kTail) return lost;
  const std::size_t places = frames - kLeadIn - kTail;
  const auto wanted =
      std::max<std::size_t>(1, static_cast<std::size_t>(std::llround(share * static_cast<double>(places))));
  // The generator's own numbers, not a distribution: these are the same with every standard library.
  std::mt19937_64 random(seed);
  for (std::size_t count = 0; count < wanted;) {
    const std::size_t place = kLeadIn + static_cast<std::size_t>(random() % places);
    count += lost[place] ? 0U : 1U;
    lost[place] = true;
  }
  return lost;
}

Json drop_rows(const Sequence& s, int lookahead, double share, std::uint64_t seed) {
  const std::vector<bool> lost = losses(s.frames.size(), share, seed);
  Json rows = Json::array();
  for (const std::string name : {"admm", "inverse", "auto", "mmae"}) {
    const auto settings = name == "admm" ? settings_of(deblur::Method::kAdmm, lookahead, kDefaultLambda)
                                         : live_settings(name, s, lookahead);
    Json& row = rows.emplace_back(place_of(s));
    row.update({{"lookahead", lookahead}, {"method", name}});
    const auto figures = settings.and_then([&](const deblur::Settings& good) { return drop_figures(s, good, lost); });
    row.update(figures ? *figures : Json{{"skipped", figures.error().message}});
  }
  return rows;
}

}  // namespace bolo::tools::fidelity
