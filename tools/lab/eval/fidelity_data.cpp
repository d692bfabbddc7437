#include "tools/lab/eval/fidelity.hpp"

#include <algorithm>
#include <memory>

#include "src/sim/random.hpp"
#include "src/sim/simulator.hpp"

namespace bolo::tools::fidelity {
namespace {

Result<std::unique_ptr<const sim::Scene>> scene_of(const SequenceTask& task, Geometry view) {
  if (task.scene == "street") return sim::make_street(view, task.seed);
  return sim::read_image(task.scene, {}).map(sim::make_still_scene);
}

// By default from the middle of a trajectory's file, away from where a hand-held recording is started and put away.
Result<sim::Path> path_of(const Motion& motion, double from_s, double to_s) {
  if (motion.is_pan()) return sim::steady_pan(motion.speed_px_s);
  ASSIGN_OR_RETURN(const auto points, sim::read_trajectory(motion.trajectory));
  const double start_s = motion.start_s.value_or((points.front().t_s + points.back().t_s) / 2.0);
  constexpr double kPointsPerFrame = 8.0;
  ASSIGN_OR_RETURN(auto path,
                   at(motion.trajectory.string(),
                      sim::follow_trajectory(points, {1.0, start_s, from_s, to_s, kPeriodS / kPointsPerFrame})));
  return path;
}

// The picture moves opposite to the view. Central difference over one frame.
sim::Position content_velocity(const sim::Path& path, double t_s) {
  const sim::Position before = path.at(t_s - kPeriodS / 2.0);
  const sim::Position after = path.at(t_s + kPeriodS / 2.0);
  return {(before.x_px - after.x_px) / kPeriodS, (before.y_px - after.y_px) / kPeriodS};
}

// Scene position of the whole frame's pixel (0, 0) at motion (0, 0).
sim::Position origin_of(const SequenceTask& task, const CleanSequence& made, const sim::Scene& scene,
                        const sim::Path& path, double from_s, double to_s) {
  if (!task.origin) return sim::centred_origin(scene, path, made.geometry, from_s, to_s);
  const sim::Position moved = path.at(kLeadIn * kPeriodS);
  return {task.origin->x_px - made.judged.x - moved.x_px, task.origin->y_px - made.judged.y - moved.y_px};
}

sim::CameraSettings camera_of(Geometry geometry, int threads) {
  sim::CameraSettings camera;
  camera.geometry = geometry;
  camera.rate_hz = 1.0 / kPeriodS;
  camera.tau_s = kTauS;
  camera.readout = {0.0, 0.0, PixelType::kFloat32, 1};
  camera.threads = threads;
  return camera;
}

}  // namespace

std::string Motion::label() const {
  if (!is_pan()) return trajectory.stem().string();
  return plot::format("%g px/s", speed_px_s);
}

Result<CleanSequence> simulate(const SequenceTask& task) {
  CleanSequence made;
  made.task = task;
  const int rows_around = task.motion.is_pan() ? 0 : kMargin;
  made.geometry = {task.crop.width + 2 * kMargin, task.crop.height + 2 * rows_around};
  made.judged = {kMargin, rows_around, task.crop.width, task.crop.height};
  ASSIGN_OR_RETURN(const auto scene, scene_of(task, made.geometry));
  const sim::CameraSettings camera = camera_of(made.geometry, task.threads);
  const auto frames = static_cast<std::size_t>(kLeadIn + (task.targets - 1) * task.stride + task.lookahead + 1);
  const double from_s = -sim::history_s(camera);
  const double to_s = static_cast<double>(frames) * kPeriodS;
  ASSIGN_OR_RETURN(const auto path, path_of(task.motion, from_s, to_s));
  made.path = path;
  const sim::Position origin = origin_of(task, made, *scene, path, from_s, to_s);
  ASSIGN_OR_RETURN(auto field, sim::pan_over(*scene, path, origin, made.geometry, from_s, to_s));
  ASSIGN_OR_RETURN(const auto simulator, sim::Simulator::create(camera, std::move(field)));

  Plane truth(made.geometry.pixels());
  for (std::size_t k = 0; k < frames; ++k) {
    made.shown.emplace_back(made.geometry.pixels());
    simulator->next(made.shown.back().data(), truth.data());
    made.truth.push_back(cut(truth, made.geometry, made.judged));
  }
  for (int i = 0; i < task.targets; ++i) {
    made.targets.push_back(static_cast<std::size_t>(kLeadIn + i * task.stride));
    made.content_v.push_back(content_velocity(path, static_cast<double>(made.targets.back()) * kPeriodS));
  }
  return made;
}

Sequence read_out(const CleanSequence& clean, double noise_k, std::uint64_t noise_seed) {
  const sim::ReadoutSettings settings{noise_k, kQuantisationK, PixelType::kUint16, noise_seed};
  Sequence made;
  made.clean = &clean;
  made.noise_k = noise_k;
  made.format = {clean.geometry, PixelType::kUint16, sim::readout_scale(settings), kPeriodS, 1};
  const auto width = static_cast<std::size_t>(clean.geometry.width);
  std::vector<double> row(width);
  std::vector<double> noise(width);
  for (std::size_t k = 0; k < clean.shown.size(); ++k) {
    made.frames.emplace_back(clean.geometry.pixels());
    for (int y = 0; y < clean.geometry.height; ++y) {
      const std::size_t first = static_cast<std::size_t>(y) * width;
      sim::fill_normal(noise_seed, k, static_cast<std::uint64_t>(y), noise);
      for (std::size_t x = 0; x < width; ++x) {
        row[x] = static_cast<double>(clean.shown[k][first + x]) + noise_k * noise[x];
      }
      sim::read_row(settings, row, made.frames.back().data() + first);
    }
  }
  return made;
}

std::vector<const void*> Sequence::window_ending_at(std::size_t frame) const {
  std::vector<const void*> planes;
  for (std::size_t k = frame + 1 - kWindow; k <= frame; ++k) planes.push_back(frames[k].data());
  return planes;
}

Plane Sequence::kelvin(std::size_t frame) const {
  Plane plane(frames[frame].size());
  std::ranges::transform(frames[frame], plane.begin(), [this](std::uint16_t value) {
    return static_cast<float>(format.scale.to_physical(static_cast<double>(value)));
  });
  return plane;
}

Plane cut(const Plane& whole, Geometry geometry, const Region& part) {
  Plane out;
  out.reserve(Geometry{part.width, part.height}.pixels());
  for (int y = part.y; y < part.y + part.height; ++y) {
    const auto first = whole.begin() + static_cast<std::ptrdiff_t>(y) * geometry.width + part.x;
    out.insert(out.end(), first, first + part.width);
  }
  return out;
}

Planes target_truth(const CleanSequence& clean) {
  Planes truth;
  for (const std::size_t k : clean.targets) truth.push_back(clean.truth[k]);
  return truth;
}

}  // namespace bolo::tools::fidelity
