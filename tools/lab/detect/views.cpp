#include <system_error>

#include "src/sim/field.hpp"
#include "tools/lab/detect/table.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::detect {
namespace {

// What a look needs of a trajectory before and after its first frame: the pixels' memory, and the frames.
constexpr double kBefore_s = 0.2;
constexpr double kAfter_s = (fidelity::kLeadIn + 4) * fidelity::kPeriodS;

using fidelity::Plane;
using fidelity::Planes;
using fidelity::Sequence;

constexpr double kWrongSpeed = 1.1;
// Beyond these, trails of fast hands take seconds a frame; the pick is rarely the last.
constexpr std::array kLucyIterations{1, 2, 4, 8, 16, 32};

// A column that a solver makes.
struct Solved {
  Column column;
  deblur::Method method = deblur::Method::kAdmm;
  int lookahead = 0;
  bool auto_lambda = false;
};

// Another solver is another line.
const std::vector<Solved>& solved_columns() {
  using enum deblur::Method;
  static const std::vector<Solved> columns{
      {{ColumnKind::kLive, "inverse", "inverse", "inverse filter"}, kInverse},
      {{ColumnKind::kLive, "qp_authors", "QP 0.1", "the paper's QP with the authors' settings"}, kAdmm},
      {{ColumnKind::kBolo, "auto", "Bolo", "Bolo: the paper's QP, lambda auto"}, kAdmm, 0, true},
      {{ColumnKind::kBolo, "auto_1", "Bolo +1", "Bolo with one frame of look-ahead"}, kAdmm, 1, true},
      {{ColumnKind::kBolo, "mmae_1", "mmae +1", "Bolo's mmae with one frame of look-ahead"}, kMmae, 1},
      {{ColumnKind::kBolo, "motion", "motion", "Bolo's motion, estimated live"}, kMotion},
      {{ColumnKind::kBolo, "motion_1", "motion +1", "Bolo's motion with one frame of look-ahead"}, kMotion, 1},
  };
  return columns;
}

std::vector<std::vector<fidelity::Tap>> kernels(const fidelity::CleanSequence& clean, double factor) {
  const double t_s = static_cast<double>(clean.targets.front()) * fidelity::kPeriodS;
  return {fidelity::path_kernel(*clean.path, t_s, fidelity::kTauS, factor)};
}

}  // namespace

Result<Still> read_still(const std::filesystem::path& file, const std::vector<JudgedClass>& classes) {
  ASSIGN_OR_RETURN(const auto image, sim::read_image(file, {}));
  Still still{file, {image.width, image.height}, false, {}};
  std::filesystem::path labels = file;
  labels.replace_extension(".txt");
  std::error_code ignored;
  if (!std::filesystem::exists(labels, ignored)) return still;
  ASSIGN_OR_RETURN(still.labels, read_labels(labels, still.size, classes));
  still.labelled = true;
  return still;
}

Result<std::vector<View>> plan_views(const std::vector<Still>& stills,
                                     const std::vector<std::filesystem::path>& trajectories, const ViewPlan& plan) {
  std::vector<View> views;
  for (std::size_t motion = 0; motion < trajectories.size(); ++motion) {
    ASSIGN_OR_RETURN(const auto points, sim::read_trajectory(trajectories[motion]));
    const double first_s = points.front().t_s + kBefore_s;
    const double last_s = points.back().t_s - kAfter_s;
    if (first_s >= last_s) {
      return bad_input(trajectories[motion].string() + ": is shorter than " + std::to_string(kBefore_s + kAfter_s) +
                       " s; give a longer one");
    }
    for (int repeat = 0; repeat < plan.repeats; ++repeat) {
      for (std::size_t still = 0; still < stills.size(); ++still) {
        Dice draw(splitmix::key(splitmix::key(plan.seed, motion),
                                static_cast<std::uint64_t>(repeat) * stills.size() + still));
        const Geometry size = stills[still].size;
        View view{still, motion, draw.between(first_s, last_s), {}};
        view.looks_at.x_px = (size.width - plan.picture.width) / 2.0 + draw.between(-kJitter.width, kJitter.width);
        view.looks_at.y_px = (size.height - plan.picture.height) / 2.0 + draw.between(-kJitter.height, kJitter.height);
        views.push_back(view);
      }
    }
  }
  return views;
}

Result<fidelity::CleanSequence> simulate(const Still& still, const std::filesystem::path& trajectory, const View& view,
                                         Geometry picture) {
  fidelity::SequenceTask task;
  task.scene = still.file.string();
  task.motion = {0.0, trajectory, view.start_s};
  task.crop = picture;
  task.targets = 1;
  task.stride = 1;
  task.lookahead = 1;
  task.threads = 1;
  task.looks_at = view.looks_at;
  return fidelity::simulate(task);
}

const std::vector<Column>& own_columns() {
  static const std::vector<Column> columns = [] {
    std::vector<Column> all{
        {ColumnKind::kSharp, "sharp", "sharp", "the true temperatures at the frame's time: the upper limit"},
        {ColumnKind::kBlurred, "blurred", "blurred", "as the camera sends it"}};
    for (const Solved& solved : solved_columns()) all.push_back(solved.column);
    all.push_back({ColumnKind::kBaseline, "unsharp", "unsharp", "unsharp mask (strength picked with the truth)"});
    all.push_back(
        {ColumnKind::kBaseline, "wiener", "Wiener", "spatial Wiener, told the camera's way (strength picked)"});
    all.push_back({ColumnKind::kBaseline, "wiener_10", "Wiener 10 %", "the same, told a way that is 10 % too long"});
    all.push_back({ColumnKind::kBaseline, "richardson_lucy", "Rich.-Lucy",
                   "Richardson-Lucy, told the camera's way (iterations picked)"});
    return all;
  }();
  return columns;
}

Result<std::vector<Levels>> shown_columns(const Sequence& s) {
  const fidelity::CleanSequence& clean = *s.clean;
  const Planes truth = fidelity::target_truth(clean);
  const Planes frames{s.kelvin(clean.targets.front())};
  std::vector<Levels> columns;
  const auto show = [&columns, span = sim::GreySpan{}](const Plane& judged) {
    columns.push_back(levels_of(judged, span.cold_k, span.hot_k));
  };
  show(truth.front());
  show(fidelity::cut(frames.front(), clean.geometry, clean.judged));
  for (const Solved& solved : solved_columns()) {
    deblur::Settings settings = fidelity::settings_of(solved.method, solved.lookahead);
    settings.auto_lambda = solved.auto_lambda;
    ASSIGN_OR_RETURN(const auto planes, fidelity::estimate(s, settings));
    show(planes.front());
  }
  const auto told = kernels(clean, 1.0);
  const auto told_wrongly = kernels(clean, kWrongSpeed);
  const fidelity::SpatialTask task{s, truth, frames, told};
  show(fidelity::picked_unsharp(s, truth, frames).planes.front());
  show(fidelity::picked_wiener(task).planes.front());
  show(fidelity::picked_wiener({s, truth, frames, told_wrongly}).planes.front());
  show(fidelity::picked_lucy(task, kLucyIterations).planes.front());
  return columns;
}

}  // namespace bolo::tools::detect
