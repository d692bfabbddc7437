#include <algorithm>
#include <mutex>

#include "src/core/statistics.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::fidelity {
namespace {

Json figures_of(const Planes& planes, const Planes& truth, const Sequence& s) {
  return measure(planes, truth, {s.clean->judged.width, s.clean->judged.height});
}

Json picked_figures(const Oracle& oracle, const Planes& truth, const Sequence& s) {
  Json figures = figures_of(oracle.planes(), truth, s);
  figures["setting"] = oracle.setting();
  return figures;
}

// The trail at each target for its velocity times a factor.
std::vector<std::vector<Tap>> motion_kernels(const CleanSequence& clean, double factor) {
  return mapped(clean.content_v, [factor](sim::Position v) {
    return motion_kernel({factor * v.x_px, factor * v.y_px}, kTauS);
  });
}

Status add_qp(const Sequence& s, const Planes& truth, int lookahead, Json& columns) {
  Oracle oracle(truth);
  for (const double lambda : kLambdas) {
    ASSIGN_OR_RETURN(auto planes, estimate(s, settings_of(deblur::Method::kAdmm, lookahead, lambda)));
    if (lambda == kAuthorsLambda) columns["qp_authors"] = figures_of(planes, truth, s);
    oracle.offer(std::move(planes), plot::format("lambda %g", lambda));
  }
  columns["qp_best"] = picked_figures(oracle, truth, s);
  return {};
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

Result<Planes> estimate(const Sequence& s, const deblur::Settings& settings) {
  ASSIGN_OR_RETURN(const auto solver, [&] {
    static std::mutex one_at_a_time;  // set-up must not run on two threads at once
    const std::lock_guard lock(one_at_a_time);
    return deblur::Solver::create(settings, s.format, PixelType::kFloat32);
  }());
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
  return out;
}

Json spatial_columns(const Sequence& s) {
  const Planes truth = target_truth(*s.clean);
  const auto wiener = [&](double factor) {
    Oracle oracle(truth);
    try_wiener(s, motion_kernels(*s.clean, factor), oracle);
    return picked_figures(oracle, truth, s);
  };
  return {{"spatial_wiener", wiener(1.0)}, {"spatial_wiener_10", wiener(kWrongSpeed)}};
}

Result<Json> evaluate(const Sequence& s, int lookahead) {
  const Planes truth = target_truth(*s.clean);
  const auto blurred =
      mapped(s.clean->targets, [&s](std::size_t k) { return cut(s.kelvin(k), s.clean->geometry, s.clean->judged); });
  Json columns{{"blurred", figures_of(blurred, truth, s)}};
  RETURN_IF_ERROR(add_qp(s, truth, lookahead, columns));
  using enum deblur::Method;
  for (const auto& [name, method] :
       {std::pair{"inverse", kInverse}, {"auto", kAdmm}, {"mmae", kMmae}, {"motion", kMotion}}) {
    deblur::Settings settings = settings_of(method, lookahead);
    settings.auto_lambda = method == kAdmm;
    const auto planes = estimate(s, settings);  // motion has no look-ahead above 1
    columns[name] = planes ? figures_of(*planes, truth, s) : Json{{"skipped", planes.error().message}};
  }
  return Json{{"scene", s.clean->task.scene},
              {"motion", s.clean->task.motion.label()},
              {"noise_k", s.noise_k},
              {"lookahead", lookahead},
              {"truth_edge_width_px", edge_width(truth, truth, s.clean->task.crop)},
              {"columns", std::move(columns)}};
}

}  // namespace bolo::tools::fidelity
