#include "tools/lab/eval/fidelity_columns.hpp"

#include <algorithm>
#include <limits>
#include <mutex>
#include <optional>
#include <utility>

#include "src/report/text.hpp"
#include "tools/lab/eval/fidelity_baselines.hpp"
#include "tools/lab/eval/fidelity_picked.hpp"

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
    auto planes = estimate(s, settings_of(deblur::Method::kAdmm, lookahead, lambda));
    if (!planes) return tl::unexpected(planes.error());
    if (lambda == kAuthorsLambda) {
      cell.columns.push_back({ColumnKind::kQpAuthors, "", "", measure(*planes, truth, judged_size(s))});
    }
    const double error = oracle.offer(std::move(*planes), plot::format("lambda %g", lambda));
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
  const auto solver = make_solver(s, settings);
  if (!solver) return tl::unexpected(solver.error());
  const CleanSequence& clean = *s.clean;
  const auto lookahead = static_cast<std::size_t>(settings.lookahead);
  Planes out;
  Plane whole(clean.geometry.pixels());
  auto next = clean.targets.begin();
  for (std::size_t k = kWindow - 1; next != clean.targets.end(); ++k) {
    const auto planes = s.window_ending_at(k + lookahead);
    const deblur::WindowView window{planes, kWindow - 1 - settings.lookahead, k + lookahead + 1};
    (*solver)->prepare(window);
    if (k != *next) continue;
    (*solver)->solve(window, clean.judged, whole.data());
    out.push_back(cut(whole, clean.geometry, clean.judged));
    ++next;
  }
  if (noise_k != nullptr) *noise_k = (*solver)->noise_k();
  return out;
}

Result<deblur::Settings> live_settings(ColumnKind kind, const Sequence& s, int lookahead) {
  const auto method = kind == ColumnKind::kMmae     ? deblur::Method::kMmae
                      : kind == ColumnKind::kMotion ? deblur::Method::kMotion
                                                    : deblur::Method::kAdmm;
  deblur::Settings settings = settings_of(method, lookahead);
  settings.auto_lambda = kind == ColumnKind::kAuto;
  const auto solver = make_solver(s, settings);
  if (!solver) return tl::unexpected(solver.error());
  const auto planes = s.window_ending_at(kWindow - 1);
  (*solver)->prepare({planes, kWindow - 1 - lookahead});
  if ((*solver)->noise_k() > 0.0) return settings;
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
  Cell cell{s.clean->task.scene, s.clean->task.motion, s.noise_k, lookahead, edge_width(truth, truth, size), {}, {}};
  cell.columns.push_back({ColumnKind::kBlurred, "", "", measure(blurred(s), truth, size)});
  const auto inverse = estimate(s, settings_of(deblur::Method::kInverse, lookahead));
  if (!inverse) return tl::unexpected(inverse.error());
  cell.columns.push_back({ColumnKind::kInverse, "", "", measure(*inverse, truth, size)});
  auto best = qp_columns(s, truth, lookahead, cell);
  if (!best) return tl::unexpected(best.error());
  cell.columns.push_back(*best);
  cell.columns.push_back(live_column(s, truth, ColumnKind::kAuto, lookahead));
  cell.columns.push_back(live_column(s, truth, ColumnKind::kMmae, lookahead));
  cell.columns.push_back(live_column(s, truth, ColumnKind::kMotion, lookahead));
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

}  // namespace bolo::tools::fidelity
