#include "tools/lab/detect/views.hpp"

#include <system_error>

#include "src/core/splitmix.hpp"
#include "src/sim/scene.hpp"

namespace bolo::tools::detect {
namespace {

// What a look needs of a trajectory before and after its first frame: the pixels' memory, and the frames.
constexpr double kBefore_s = 0.2;
constexpr double kAfter_s = (fidelity::kLeadIn + 4) * fidelity::kPeriodS;

// Random numbers of one look.
class Draw {
 public:
  Draw(std::uint64_t seed, std::uint64_t motion, std::uint64_t look)
      : key_(splitmix::key(splitmix::key(seed, motion), look)) {}
  double between(double low, double high) { return low + (high - low) * splitmix::unit(splitmix::key(key_, next_++)); }

 private:
  std::uint64_t key_;
  std::uint64_t next_ = 0;
};

}  // namespace

Result<Still> read_still(const std::filesystem::path& file, const std::vector<JudgedClass>& classes) {
  const auto image = sim::read_image(file, {});
  if (!image) return tl::unexpected(image.error());
  Still still{file, {image->width, image->height}, false, {}};
  std::filesystem::path labels = file;
  labels.replace_extension(".txt");
  std::error_code ignored;
  if (!std::filesystem::exists(labels, ignored)) return still;
  auto read = read_labels(labels, still.size, classes);
  if (!read) return tl::unexpected(read.error());
  still.labelled = true;
  still.labels = std::move(*read);
  return still;
}

Result<std::vector<View>> plan_views(const std::vector<Still>& stills,
                                     const std::vector<std::filesystem::path>& trajectories, const ViewPlan& plan) {
  std::vector<View> views;
  for (std::size_t motion = 0; motion < trajectories.size(); ++motion) {
    const auto points = sim::read_trajectory(trajectories[motion]);
    if (!points) return tl::unexpected(points.error());
    const double first_s = points->front().t_s + kBefore_s;
    const double last_s = points->back().t_s - kAfter_s;
    if (first_s >= last_s) {
      return bad_input(trajectories[motion].string() + ": is shorter than " + std::to_string(kBefore_s + kAfter_s) +
                       " s; give a longer one");
    }
    for (int repeat = 0; repeat < plan.repeats; ++repeat) {
      for (std::size_t still = 0; still < stills.size(); ++still) {
        Draw draw(plan.seed, motion, static_cast<std::uint64_t>(repeat) * stills.size() + still);
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

}  // namespace bolo::tools::detect
