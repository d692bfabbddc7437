#include "tools/lab/detect/columns.hpp"

#include <utility>

#include "src/sim/scene.hpp"
#include "tools/lab/eval/fidelity_columns.hpp"
#include "tools/lab/eval/fidelity_picked.hpp"

namespace bolo::tools::detect {
namespace {

using fidelity::Plane;
using fidelity::Planes;
using fidelity::Sequence;

constexpr double kWrongSpeed = 1.1;
// Beyond these, trails of fast hands take seconds a frame; the pick is rarely the last.
constexpr std::array kLucyIterations{1, 2, 4, 8, 16, 32};

deblur::Settings bolo_settings(deblur::Method method, int lookahead) {
  deblur::Settings settings = fidelity::settings_of(method, lookahead);
  settings.auto_lambda = method == deblur::Method::kAdmm;
  return settings;
}

class Columns {
 public:
  explicit Columns(const Sequence& sequence) : s_(sequence) {}

  void show(const Plane& judged, std::string setting = {}) {
    const sim::GreySpan span;
    shown_.push_back({levels_of(judged, span.cold_k, span.hot_k), std::move(setting)});
  }
  void show(const fidelity::Picked& picked) { show(picked.planes.front(), picked.setting); }

  Status solve(const deblur::Settings& settings) {
    const auto planes = fidelity::estimate(s_, settings);
    if (!planes) return tl::unexpected(planes.error());
    show(planes->front());
    return {};
  }

  std::vector<Shown> take() { return std::move(shown_); }

 private:
  const Sequence& s_;
  std::vector<Shown> shown_;
};

std::vector<std::vector<fidelity::Tap>> kernels(const fidelity::CleanSequence& clean, double factor) {
  const double t_s = static_cast<double>(clean.targets.front()) * fidelity::kPeriodS;
  return {fidelity::path_kernel(*clean.path, t_s, fidelity::kTauS, factor)};
}

}  // namespace

const std::vector<Column>& own_columns() {
  static const std::vector<Column> columns{
      {ColumnKind::kSharp, "sharp", "sharp", "the true temperatures at the frame's time: the upper limit"},
      {ColumnKind::kBlurred, "blurred", "blurred", "as the camera sends it"},
      {ColumnKind::kLive, "inverse", "inverse", "inverse filter"},
      {ColumnKind::kLive, "qp_authors", "QP 0.1", "the paper's QP with the authors' settings"},
      {ColumnKind::kBolo, "auto", "Bolo", "Bolo: the paper's QP, lambda auto"},
      {ColumnKind::kBolo, "auto_1", "Bolo +1", "Bolo with one frame of look-ahead"},
      {ColumnKind::kBolo, "mmae_1", "mmae +1", "Bolo's mmae with one frame of look-ahead"},
      {ColumnKind::kBaseline, "unsharp", "unsharp", "unsharp mask (strength picked with the truth)"},
      {ColumnKind::kBaseline, "wiener", "Wiener", "spatial Wiener, told the camera's way (strength picked)"},
      {ColumnKind::kBaseline, "wiener_10", "Wiener 10 %", "the same, told a way that is 10 % too long"},
      {ColumnKind::kBaseline, "richardson_lucy", "Rich.-Lucy",
       "Richardson-Lucy, told the camera's way (iterations picked)"},
  };
  return columns;
}

Result<std::vector<Shown>> shown_columns(const Sequence& s) {
  const fidelity::CleanSequence& clean = *s.clean;
  const Planes truth = fidelity::target_truth(clean);
  const Planes frames{s.kelvin(clean.targets.front())};
  Columns columns(s);
  columns.show(truth.front());
  columns.show(fidelity::cut(frames.front(), clean.geometry, clean.judged));
  for (const deblur::Settings& settings :
       {fidelity::settings_of(deblur::Method::kInverse, 0),
        fidelity::settings_of(deblur::Method::kAdmm, 0, fidelity::kAuthorsLambda),
        bolo_settings(deblur::Method::kAdmm, 0), bolo_settings(deblur::Method::kAdmm, 1),
        bolo_settings(deblur::Method::kMmae, 1)}) {
    if (Status done = columns.solve(settings); !done) return tl::unexpected(done.error());
  }
  const auto told = kernels(clean, 1.0);
  const auto told_wrongly = kernels(clean, kWrongSpeed);
  const fidelity::SpatialTask task{s, truth, frames, told};
  columns.show(fidelity::picked_unsharp(s, truth, frames));
  columns.show(fidelity::picked_wiener(task));
  columns.show(fidelity::picked_wiener({s, truth, frames, told_wrongly}));
  columns.show(fidelity::picked_lucy(task, kLucyIterations));
  return columns.take();
}

}  // namespace bolo::tools::detect
