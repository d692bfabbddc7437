#include <system_error>

#include "src/sim/field.hpp"
#include "tools/lab/detect/table.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::detect {
namespace {

// Time that a view needs in a trajectory before and after its first frame: the pixels' memory, and the frames.
constexpr double kBefore_s = 0.2;
constexpr double kAfter_s = (fidelity::kLeadIn + 4) * fidelity::kPeriodS;

using fidelity::Plane;
using fidelity::Planes;
using fidelity::Sequence;

struct Solved {
  Column column;
  deblur::Method method = deblur::Method::kAdmm;
  int lookahead = 0;
  bool auto_lambda = false;
};

// To add a solver, add a line.
const std::vector<Solved>& solved_columns() {
  using enum deblur::Method;
  static const std::vector<Solved> all{
      {{"inverse", "inverse filter"}, kInverse},
      {{"qp_authors", "the paper's QP with the authors' settings"}, kAdmm},
      {{"auto", "Bolo: the paper's QP, lambda auto"}, kAdmm, 0, true},
      {{"auto_1", "Bolo with one frame of look-ahead"}, kAdmm, 1, true},
      {{"mmae_1", "Bolo's mmae with one frame of look-ahead"}, kMmae, 1},
      {{"motion", "Bolo's motion, estimated live"}, kMotion},
      {{"motion_1", "Bolo's motion with one frame of look-ahead"}, kMotion, 1},
  };
  return all;
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
        view.origin.x_px = (size.width - plan.picture.width) / 2.0 + draw.between(-kJitter.width, kJitter.width);
        view.origin.y_px = (size.height - plan.picture.height) / 2.0 + draw.between(-kJitter.height, kJitter.height);
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
  task.origin = view.origin;
  return fidelity::simulate(task);
}

const std::vector<Column>& columns() {
  static const std::vector<Column> all = [] {
    std::vector<Column> made{{"sharp", "the true temperatures at the frame's time: the upper limit"},
                             {"blurred", "as the camera sends it"}};
    for (const Solved& solved : solved_columns()) made.push_back(solved.column);
    made.push_back({"wiener", "spatial Wiener, told the camera's way (strength picked with the truth)"});
    made.push_back({"wiener_10", "the same, told a way that is 10 % too long"});
    return made;
  }();
  return all;
}

Result<std::vector<Levels>> shown_columns(const Sequence& s) {
  const fidelity::CleanSequence& clean = *s.clean;
  const Planes truth = fidelity::target_truth(clean);
  std::vector<Levels> shown;
  const auto show = [&shown, span = sim::GreySpan{}](const Plane& judged) {
    shown.push_back(levels_of(judged, span.cold_k, span.hot_k));
  };
  show(truth.front());
  show(fidelity::cut(s.kelvin(clean.targets.front()), clean.geometry, clean.judged));
  for (const Solved& solved : solved_columns()) {
    deblur::Settings settings = fidelity::settings_of(solved.method, solved.lookahead);
    settings.auto_lambda = solved.auto_lambda;
    ASSIGN_OR_RETURN(const auto planes, fidelity::estimate(s, settings));
    show(planes.front());
  }
  const double t_s = static_cast<double>(clean.targets.front()) * fidelity::kPeriodS;
  for (const double factor : {1.0, fidelity::kWrongSpeed}) {
    fidelity::Oracle oracle(truth);
    fidelity::try_wiener(s, {fidelity::path_kernel(*clean.path, t_s, fidelity::kTauS, factor)}, oracle);
    show(oracle.planes().front());
  }
  return shown;
}

}  // namespace bolo::tools::detect
