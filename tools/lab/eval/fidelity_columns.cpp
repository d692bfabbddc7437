#include "tools/lab/eval/fidelity_columns.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <random>
#include <utility>

#include "src/core/clock.hpp"
#include "src/deblur/window.hpp"
#include "src/report/text.hpp"
#include "tools/lab/eval/fidelity_filters.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr double kWrongSpeed = 1.1;

Geometry judged_size(const Sequence& s) { return {s.clean->judged.width, s.clean->judged.height}; }

Column column_of(ColumnKind kind, const Picked& picked, const Planes& truth, const Sequence& s) {
  return {kind, picked.setting, "", measure(picked.planes, truth, judged_size(s))};
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
Result<Column> qp_columns(const Sequence& s, const Planes& truth, int lookahead, Cell& cell) {
  Oracle oracle(truth);
  for (const double lambda : kLambdas) {
    ASSIGN_OR_RETURN(auto planes, estimate(s, settings_of(deblur::Method::kAdmm, lookahead, lambda)));
    if (lambda == kAuthorsLambda) {
      cell.columns.push_back({ColumnKind::kQpAuthors, "", "", measure(planes, truth, judged_size(s))});
    }
    const double error = oracle.offer(std::move(planes), plot::format("lambda %g", lambda));
    cell.grid.push_back({lambda, error});
  }
  return column_of(ColumnKind::kQpBest, oracle.best(), truth, s);
}

Column live_column(const Sequence& s, const Planes& truth, ColumnKind kind, int lookahead) {
  const auto settings = live_settings(kind, s, lookahead);
  if (!settings) return {kind, "", settings.error().message, {}};
  double noise_k = 0.0;
  const auto planes = estimate(s, *settings, &noise_k);
  if (!planes) return {kind, "", planes.error().message, {}};
  return {kind, plot::format("noise measured %.3f K", noise_k), "", measure(*planes, truth, judged_size(s))};
}

double live_rmse(const Sequence& s, const Planes& truth, ColumnKind kind, int lookahead) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (kind == ColumnKind::kQpBest) {
    Oracle oracle(truth);
    for (const double lambda : kLambdas) {
      auto planes = estimate(s, settings_of(deblur::Method::kAdmm, lookahead, lambda));
      if (!planes) return kNone;
      oracle.offer(std::move(*planes), "");
    }
    return oracle.rmse_k();
  }
  const auto settings = kind == ColumnKind::kInverse
                            ? Result<deblur::Settings>(settings_of(deblur::Method::kInverse, lookahead))
                            : live_settings(kind, s, lookahead);
  if (!settings) return kNone;
  const auto planes = estimate(s, *settings);
  return planes ? rmse(*planes, truth) : kNone;
}

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kDefaultLambda = deblur::Settings{}.lambda;

double mean_squared_error(const Plane& a, const Plane& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = static_cast<double>(a[i]) - static_cast<double>(b[i]);
    sum += d * d;
  }
  return sum / static_cast<double>(a.size());
}

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
      errors[ready.frame.token] =
          mean_squared_error(cut(whole, clean.geometry, clean.judged), clean.truth[ready.frame.token]);
    }
  }
  return errors;
}

// Root of the mean over frames.
struct Sums {
  std::array<double, 3> sum{};
  int frames = 0;

  void add(const std::array<double, 3>& errors) {
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += errors[i];
    ++frames;
  }
  DropErrors errors() const {
    const auto rms = [this](std::size_t i) { return frames > 0 ? std::sqrt(sum[i] / frames) : kNone; };
    return {rms(0), rms(1), rms(2), frames};
  }
};

bool near_loss(const std::vector<bool>& lost, std::size_t k) {
  const std::size_t from = k > kNearLoss ? k - kNearLoss : 0;
  for (std::size_t i = from; i <= std::min(k + kNearLoss, lost.size() - 1); ++i) {
    if (lost[i]) return true;
  }
  return false;
}

Status fill(const Sequence& s, const deblur::Settings& settings, const std::vector<bool>& lost, DropRow& row) {
  std::vector<std::size_t> all(s.frames.size());
  std::iota(all.begin(), all.end(), 0U);
  std::vector<std::size_t> arrived;
  std::ranges::copy_if(all, std::back_inserter(arrived), [&](std::size_t k) { return !lost[k]; });
  const std::array streams{stream_errors(s, settings, all, false), stream_errors(s, settings, arrived, false),
                           stream_errors(s, settings, arrived, true)};
  for (const auto& stream : streams) {
    if (!stream) return tl::unexpected(stream.error());
  }
  Sums every;
  Sums near;
  for (std::size_t k = kLeadIn; k < all.size(); ++k) {
    const std::array errors{(*streams[0])[k], (*streams[1])[k], (*streams[2])[k]};
    if (std::ranges::any_of(errors, [](double e) { return std::isnan(e); })) continue;
    every.add(errors);
    if (near_loss(lost, k)) near.add(errors);
  }
  row.all = every.errors();
  row.near = near.errors();
  row.frames_lost = static_cast<int>(std::ranges::count(lost, true));
  return {};
}

}  // namespace

const Column& Cell::column(ColumnKind kind) const {
  return *std::ranges::find_if(columns, [kind](const Column& c) { return c.kind == kind; });
}

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

Result<std::unique_ptr<deblur::Solver>> make_solver(const Sequence& s, const deblur::Settings& settings) {
  static std::mutex one_at_a_time;  // set-up is no place for two threads
  const std::lock_guard lock(one_at_a_time);
  return deblur::Solver::create(settings, s.format, PixelType::kFloat32);
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

Result<deblur::Settings> live_settings(ColumnKind kind, const Sequence& s, int lookahead) {
  const deblur::Method method = kColumns[static_cast<std::size_t>(kind)].live.value_or(deblur::Method::kAdmm);
  deblur::Settings settings = settings_of(method, lookahead);
  settings.auto_lambda = kind == ColumnKind::kAuto;
  ASSIGN_OR_RETURN(const auto solver, make_solver(s, settings));
  const auto planes = s.window_ending_at(kWindow - 1);
  solver->prepare({planes, kWindow - 1 - lookahead});
  if (solver->noise_k() > 0.0) return settings;
  return bad_input("this build's solver does not measure the noise");
}

std::vector<Column> spatial_columns(const Sequence& s) {
  const Planes truth = target_truth(*s.clean);
  Planes frames;
  for (const std::size_t target : s.clean->targets) frames.push_back(s.kelvin(target));
  const auto told = motion_kernels(*s.clean, 1.0);
  const auto told_wrongly = motion_kernels(*s.clean, kWrongSpeed);
  const SpatialTask task{s, truth, frames, told};
  return {column_of(ColumnKind::kUnsharp, picked_unsharp(s, truth, frames), truth, s),
          column_of(ColumnKind::kSpatialWiener, picked_wiener(task), truth, s),
          column_of(ColumnKind::kSpatialWienerOff, picked_wiener({s, truth, frames, told_wrongly}), truth, s),
          column_of(ColumnKind::kRichardsonLucy, picked_lucy(task), truth, s)};
}

Result<Cell> evaluate(const Sequence& s, const Sequence& training, int lookahead) {
  const Planes truth = target_truth(*s.clean);
  const Geometry size = judged_size(s);
  Cell cell{{s.clean->task.scene, s.clean->task.motion, s.noise_k, lookahead}, edge_width(truth, truth, size), {}, {}};
  cell.columns.push_back({ColumnKind::kBlurred, "", "", measure(blurred(s), truth, size)});
  ASSIGN_OR_RETURN(const auto inverse, estimate(s, settings_of(deblur::Method::kInverse, lookahead)));
  cell.columns.push_back({ColumnKind::kInverse, "", "", measure(inverse, truth, size)});
  ASSIGN_OR_RETURN(auto best, qp_columns(s, truth, lookahead, cell));
  cell.columns.push_back(best);
  for (const ColumnName& column : kColumns) {
    if (column.live) cell.columns.push_back(live_column(s, truth, column.kind, lookahead));
  }
  const Planes fitted = TemporalWiener(training, lookahead).apply(s);
  cell.columns.push_back({ColumnKind::kTemporalWiener, "", "", measure(fitted, truth, size)});
  return cell;
}

Result<LatencyCurves> latency_curves(const Sequence& s, int longest) {
  const Planes truth = target_truth(*s.clean);
  LatencyCurves curves;
  curves.scene = s.clean->task.scene;
  curves.motion = s.clean->task.motion;
  curves.noise_k = s.noise_k;
  curves.blurred_rmse_k = rmse(blurred(s), truth);
  for (int lookahead = 0; lookahead <= longest; ++lookahead) {
    curves.lookaheads.push_back(lookahead);
    for (std::size_t c = 0; c < kLiveColumns.size(); ++c) {
      curves.rmse_k[c].push_back(live_rmse(s, truth, kLiveColumns[c], lookahead));
    }
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

Result<std::vector<DropRow>> drop_rows(const Sequence& s, int lookahead, double share, std::uint64_t seed) {
  const std::vector<bool> lost = losses(s.frames.size(), share, seed);
  using deblur::Method;
  const std::vector<std::pair<std::string, Result<deblur::Settings>>> methods{
      {"admm", settings_of(Method::kAdmm, lookahead, kDefaultLambda)},
      {"inverse", settings_of(Method::kInverse, lookahead)},
      {"auto", live_settings(ColumnKind::kAuto, s, lookahead)},
      {"mmae", live_settings(ColumnKind::kMmae, s, lookahead)}};
  std::vector<DropRow> rows;
  for (const auto& [name, settings] : methods) {
    DropRow row{{s.clean->task.scene, s.clean->task.motion, s.noise_k, lookahead}, name, "", 0, {}, {}};
    if (!settings) {
      row.skipped = settings.error().message;
    } else if (const Status filled = fill(s, *settings, lost, row); !filled) {
      row.skipped = filled.error().message;
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace bolo::tools::fidelity
