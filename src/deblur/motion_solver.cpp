#include "src/deblur/motion_solver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/core/clock.hpp"
#include "src/deblur/method.hpp"
#include "src/deblur/noise_meter.hpp"

namespace bolo::deblur {
namespace {

constexpr double kLargestDifference = 31.6;  // K, bound of the innovations' differences in matching
constexpr float kMovesItself = 0.5F;         // px a frame
constexpr double kCut = 2.0;                 // px, residual of half of the picture
constexpr double kTimesNext = 4.0;           // times the residual of the neighbouring displacements
constexpr double kNearly = 1.5;              // times the residual of a frame that may be a cut, relative to a cut's
constexpr double kOfNoise = 2.0;             // times the displacement's uncertainty: residual due to noise
constexpr int kBefore = 3;            // number of earlier displacements that one without a match is compared with
constexpr double kUnconfirmed = 7.0;  // px a frame: faster motion must be seen twice
constexpr double kAbrupt = 0.9;       // of Path::steady: above it, nothing has just stopped
// If the extrapolated frame in between is off by e, the displacement found exceeds the true one by (1 + rho) e, and
// that exceeds the extrapolated one by about 2 e (changes add up). A second extrapolated frame is off by 3 e.
constexpr double kTimesFurther = 2.0;
constexpr double kSuspicious = 0.5;  // share of Displacement::beyond that counts in the search for a stop

// The same task in the values' own unit, with float output.
StreamTask in_values(StreamTask task) {
  task.noise_floor = least_noise(task.input);
  task.settings.noise_k /= task.input.scale.unit == Unit::kKelvin ? std::abs(task.input.scale.scale) : 1.0;
  task.settings.method = Method::kMmae;
  task.input.scale = {};
  task.input.scale.unit = Unit::kCount;
  task.output = PixelType::kFloat32;
  return task;
}

}  // namespace

MotionSolver::MotionSolver(const StreamTask& task)
    : task_(task),
      mmae_(in_values(task)),
      kernels_(motion::best_kernels(mmae_.isa())),
      inertia_(task.settings.tau_s / task.settings.period_s),
      global_(followed()),
      gyro_(task.input.geometry, task.input.row_step, task.settings.gyro_setup, task.settings.period_s, inertia_),
      local_(followed()),
      after_cut_(followed(), kFrames),
      block_motions_(task.input.geometry),
      defects_(followed()),
      covered_(defects_.most() * (kFrames + 1)) {
  const Geometry g = task.input.geometry;
  if (usable()) {
    motion::WeightTable::of(inertia_.tau, task.settings.lookahead);  // all tables at once
    for (int ahead = 0; ahead <= task.settings.lookahead; ++ahead) estimators_.emplace_back(g, inertia_, ahead);
  }
  for (Frame& f : frames_) f.values = motion::PaddedPlane(followed());
  for (int i = 0; i < 3; ++i)
    innovations_.push_back({false, motion::PaddedPlane(followed()), motion::Pyramid(followed())});
  field_ = motion::VectorField(motion::blocks_over(g.width), motion::blocks_over(g.height));
  for (int row = 0; task.delays_rows() && row < field_.down(); ++row) {
    const int middle = std::min(row * motion::kBlock + motion::kBlock / 2, g.height - 1);
    row_delay_.push_back(static_cast<float>(task.row_delay(middle)));
  }
  per_pixel_.resize(g.pixels());
  estimate_.resize(g.pixels());
  per_pixel_error_.resize(field_.size());
}

bool MotionSolver::usable() const noexcept {
  const bool weighed = inertia_.tau >= motion::kShortestTau && inertia_.tau <= motion::kLongestTau;
  return weighed && std::min(task_.input.geometry.width, task_.input.geometry.height) >= motion::kLeastSide;
}

// Size of the frames whose motion is estimated; one block if none is: padding would outgrow low frames.
Geometry MotionSolver::followed() const noexcept {
  return usable() ? task_.input.geometry : Geometry{motion::kBlock, motion::kBlock};
}

double MotionSolver::noise_k() const noexcept { return task_.in_kelvin(mmae_.noise()); }
double MotionSolver::measured_noise_k() const noexcept { return task_.in_kelvin(mmae_.measured_noise()); }

void MotionSolver::forget() noexcept {
  for (Frame& f : frames_) f.there = f.lost = false;
  for (Innovation& i : innovations_) i.there = false;
  for (Displacement& d : displacements_) d.there = false;
  defects_.forget();
}

// Split like the kernels that read it, so that each row is fetched from memory once.
void MotionSolver::load(const void* plane, Crew& crew, motion::PaddedPlane& to) const noexcept {
  for_rows(crew, to.blocks_down(), [&](int block_row) {
    const auto [begin, end] = to.rows_of(block_row);
    for (int y = begin; y < end; ++y) task_.load_row(plane, y, to.at(0, y));
    to.mirror_sides(begin, end);  // taps at the border see its gradient
  });
  to.mirror_ends();
}

// Extrapolates a lost frame, or the second of two, as if the motion had continued: its innovation is the one before,
// moved. Only the first estimate after it uses it. False if the three frames before the first do not give their motion.
bool MotionSolver::bridge(Crew& crew) noexcept {
  const bool second = frame(1).lost;
  if (second && (!frame(1).there || frame(2).lost)) return false;
  if (!second && (!displacement(1).there || frame(2).lost || frame(3).lost)) return false;
  motion::Affine& d = displacement(0).motion;
  d = displacement(1).motion;
  if (second || (displacement(2).there && !frame(4).lost)) d = motion::foretold(d, displacement(2).motion);
  motion::spread(d, task_.input.geometry, 1, field_);
  const motion::PaddedPlane& before = frame(1).values;
  motion::PaddedPlane& to = frame(0).values;
  const auto rho = static_cast<float>(inertia_.rho);
  for_rows(crew, to.blocks_down(), [&](int block_row) {
    kernels_.shift(innovation(1).values, field_.row(block_row), block_row, to);
    const auto [begin, end] = to.rows_of(block_row);
    for (int y = begin; y < end; ++y) {
      float* const row = to.at(0, y);
      const float* const old = before.at(0, y);
      for (int x = 0; x < task_.input.geometry.width; ++x) row[x] += rho * (old[x] - row[x]);
    }
    to.mirror_sides(begin, end);
  });
  to.mirror_ends();
  return true;
}

// Takes in the next period's frame; null: lost.
void MotionSolver::take(const void* plane, Crew& crew) noexcept {
  ++taken_;
  Frame& now = frame(0);
  Innovation& z = innovation(0);
  Displacement& d = displacement(0);
  now.lost = plane == nullptr;
  now.there = !now.lost || bridge(crew);
  z.there = now.there && frame(1).there;
  d.there = z.there && innovation(1).there && !now.lost;
  const int back = frame(1).lost ? 1 : 2;
  d.bridged = !frame(back).lost ? 0 : frame(back + 1).lost ? 2 : 1;
  d.beyond = {};
  if (!now.lost) {
    load(plane, crew, now.values);
    defects_.add(kernels_, now.values, static_cast<float>(mmae_.noise()), crew);
  }
  if (z.there) find_innovation(kernels_, inertia_, now.values, frame(1).values, crew, z.values, z.smoothed);
  if (d.there) {
    const double more = frame(1).lost ? std::sqrt(1.0 + inertia_.rho * inertia_.rho) : 1.0;
    d.motion = global_.find(kernels_, inertia_, innovation(1).smoothed, z.smoothed, more * mmae_.noise(), crew);
    d.uncertainty = global_.uncertainty();
    d.misfit = global_.misfit();
    if (frame(1).lost) {
      const motion::Affine expected = motion::foretold(displacement(1).motion, displacement(2).motion);
      const motion::Affine off = d.motion + expected * -1.0;
      const double further = kTimesFurther + d.bridged - 1;
      const double off_by = d.bridged == 1 ? 1.0 + inertia_.rho : further + inertia_.rho * (further + inertia_.rho);
      d.beyond = off * (off_by / (further + off_by));
      d.motion = d.motion + d.beyond * -1.0;
    }
  }
  d.cut = d.there && d.misfit > cut_bound(1, 1 + kBefore);
}

// False for displacements of lost frames, and for those that bridge one, except the estimated frame's own.
bool MotionSolver::is_found(int back) noexcept {
  const Displacement& d = displacement(back);
  return d.there && (d.bridged == 0 || back <= task_.settings.lookahead);
}

// Misfit above which a displacement belongs to a cut, though the displacements [from, to) fit. A scene of many motions
// never fits.
double MotionSolver::cut_bound(int from, int to) noexcept {
  double least = std::numeric_limits<double>::max();
  for (int i = from; i < to; ++i) {
    if (displacement(i).there) least = std::min(least, displacement(i).misfit);
  }
  return std::max(kCut, kTimesNext * least);
}

// True if a displacement belongs to a cut, by those before it when it was found, or by the newer ones from `newest` on:
// either may be displacements of a scene whose contrast is little more than noise, which fit badly.
bool MotionSolver::is_cut(int at, int newest) noexcept {
  return is_found(at) && (displacement(at).cut || displacement(at).misfit > cut_bound(newest, at));
}

// Number of displacements, back from that of the period `newest` before the newest, within one scene.
int MotionSolver::scene_length(int newest) noexcept {
  int length = 1;
  while (length < motion::kHistory && !is_cut(newest + length, newest)) ++length;
  return length;
}

// Number of known displacements in the scene, besides that of the period `newest` before the newest.
int MotionSolver::known_before(int newest) noexcept {
  int known = 0;
  for (int i = scene_length(newest) - 1; i > 0; --i) known += is_found(newest + i) ? 1 : 0;
  return known;
}

// The displacements from period `newest` (before the newest) on, less the gyro's. Unknown ones lie on the parabola
// through the one after and the two before them; before a cut, and before the first, the last is kept. `bridged`: those
// that bridge a lost frame count as known, and two lost frames if the newest does so.
motion::Displacements MotionSolver::history(int newest, const motion::GyroMotions& by_gyro, bool bridged) noexcept {
  motion::Displacements left;
  const auto length = static_cast<std::size_t>(scene_length(newest));
  const auto at = [&](std::size_t i) -> const Displacement& { return displacement(newest + static_cast<int>(i)); };
  const int most = at(0).bridged < 2 ? 1 : 2;
  const auto known = [&](std::size_t i) {
    if (i == 0 || i >= length) return i == 0;
    return bridged ? at(i).there && at(i).bridged <= most : is_found(newest + static_cast<int>(i));
  };
  const auto rest = [&](std::size_t i) { return at(i).motion + by_gyro.displacements[i] * -1.0; };
  std::size_t last = 0;
  for (std::size_t i = 0; i < left.size(); ++i) {
    if (known(i)) {
      left[last = i] = rest(i);
      continue;
    }
    std::size_t next = i;
    while (next < length && !known(next)) ++next;
    left[i] = left[last];
    if (next >= length) continue;
    const auto gap = static_cast<double>(next - last);
    const auto along = static_cast<double>(i - last);
    const motion::Affine slope = (rest(next) + left[last] * -1.0) * (1.0 / gap);
    left[i] = left[i] + slope * along;
    if (!known(next + 1)) continue;
    const motion::Affine bend = rest(next + 1) + (rest(next) + slope) * -1.0;
    left[i] = left[i] + bend * (along * (along - gap) / (gap + 1.0));
  }
  return left;
}

// Finds the gyro's displacements and the residuals `left`. True if they agree with the picture's.
bool MotionSolver::use_gyro(const FrameMeta& meta, int newest, motion::Displacements& left,
                            motion::GyroMotions& by_gyro) noexcept {
  Gyro* const gyro = task_.settings.gyro;
  if (gyro == nullptr) return false;
  const double later_s = (task_.settings.lookahead - newest) * task_.settings.period_s;
  gyro_use_ = GyroUse::kSilent;
  if (!gyro_.find(gyro->samples(), gyro->time_of(meta) + to_ns(later_s), by_gyro)) return false;
  const motion::Displacements rest = history(newest, by_gyro);
  gyro_use_ = GyroUse::kIgnored;
  if (!motion::gyro_agrees(left, rest, displacement(newest).uncertainty)) return false;
  gyro_use_ = GyroUse::kUsed;
  left = rest;
  return true;
}

// False if the estimated frame's own displacement is not known.
bool MotionSolver::find_path(const FrameMeta& meta, motion::Path& path, bool& ahead) noexcept {
  const int target = task_.settings.lookahead;
  gyro_use_.reset();
  if (!displacement(target).there) return false;
  ahead = target == 1 && displacement(0).there;
  const int newest = ahead ? 0 : target;
  if (target >= newest + scene_length(newest)) return false;
  motion::GyroMotions by_gyro;
  motion::Displacements left = history(newest, by_gyro);
  const bool knows = use_gyro(meta, newest, left, by_gyro);
  const double uncertainty = displacement(newest).uncertainty;
  const motion::GyroMotions* const gyro = knows ? &by_gyro : nullptr;
  path = motion::path_of(inertia_, left, ahead, uncertainty, gyro);
  const int known = known_before(newest);
  if (known + 1 < scene_length(newest)) {  // interpolation between known displacements would smooth a stop away
    motion::Displacements all = history(newest, knows ? by_gyro : motion::GyroMotions{}, true);
    all[0] = all[0] + displacement(newest).beyond * kSuspicious;
    path.steady = motion::path_of(inertia_, all, ahead, uncertainty, gyro).steady;
  }
  for (int i = 0; i <= target; ++i) {
    const Displacement& d = displacement(i);
    const double beyond_noise = std::max(d.misfit - kOfNoise * d.uncertainty, 0.0);
    // The frame after a cut does not match the cut's own, a mixture of both scenes; its motion is right nevertheless.
    const double cut = displacement(i + 1).cut ? 0.0 : kNearly * beyond_noise / cut_bound(i + 1, i + 1 + kBefore);
    path.steady *= d.cut ? 0.0 : 1.0 / (1.0 + std::pow(cut, 4.0));
  }
  if (known == 0) {  // repeated texture matches far away, too
    const motion::Vec2 d = displacement(newest).motion.at(0.0, 0.0);
    path.steady /= 1.0 + std::pow(std::hypot(d.x, d.y) / kUnconfirmed, 4.0);
  }
  motion::spread(path.displacement, task_.input.geometry, 1, field_);
  return true;
}

// While the gyro shows rest, each innovation is the scene itself: the mean over `rests` frames is averaged with the
// per-pixel estimates, which assume motion, in blocks that do not move by themselves.
void MotionSolver::use_rest(int rests, const motion::VectorField& deviation) noexcept {
  const int target = task_.settings.lookahead;
  const int count = std::min(rests, 2);  // the innovations that the displacement is of
  const double rho = inertia_.rho;
  const double of_first = (1.0 - rho) * (1.0 - rho);
  const auto error = static_cast<float>((1.0 + rho * rho + (count - 1) * of_first) / (of_first * count * count));
  const Geometry g = task_.input.geometry;
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) {
      const int block = y / motion::kBlock * field_.across() + x / motion::kBlock;
      const auto b = static_cast<std::size_t>(block);
      if (std::hypot(deviation[b].x, deviation[b].y) > kMovesItself) continue;
      const float other = per_pixel_error_[b];
      float mean = 0.0F;
      for (int i = target; i < target + count; ++i) mean += *innovation(i).values.at(x, y) / static_cast<float>(count);
      float& value = per_pixel_[static_cast<std::size_t>(y * g.width + x)];
      value += other * other / (other * other + error * error) * (mean - value);
    }
  }
}

// In parts of whole rows of blocks, so that each block's error is written once.
void MotionSolver::solve_per_pixel(const WindowView& window, Crew& crew) noexcept {
  const Geometry g = task_.input.geometry;
  for_parts(crew, field_.down(), [&](int begin, int end) {
    const int top = begin * motion::kBlock;
    const int bottom = std::min(end * motion::kBlock, g.height);
    mmae_.solve(window, {0, top, g.width, bottom - top}, per_pixel_.data(), per_pixel_error_.data());
  });
}

void MotionSolver::prepare(const WindowView& window, Crew& crew) noexcept {
  mmae_.prepare(window, crew);
  solve_per_pixel(window, crew);
  const auto slots = static_cast<std::uint64_t>(window.planes.size());
  if (usable()) {
    const std::uint64_t steps = window.newest - newest_;  // wraps round if time went back
    const bool follows = newest_ != 0 && window.newest > newest_ && steps <= kFirst;
    if (!follows) forget();
    const std::uint64_t first = slots - (follows ? steps : std::min<std::uint64_t>(kFirst, slots));
    for (std::uint64_t i = first; i < slots; ++i) take(window.planes[i], crew);
    newest_ = window.newest;
  }
  motion::Path path;
  bool ahead = false;
  tells_motion_ = false;
  if (!usable() || !find_path(window.meta, path, ahead)) {
    estimate_ = per_pixel_;
    return;
  }
  const int target = task_.settings.lookahead;
  tells_motion_ = displacement(target).bridged == 0;
  const motion::VectorField& deviation = deviations(path.displacement, crew);
  if (path.rests > 0 && path.steady < kAbrupt) use_rest(path.rests, deviation);
  block_motions_.find(inertia_, {path.trail, deviation, local_.misfit(), local_.sums(), mmae_.noise()});
  const std::span<const std::uint32_t> defects = defects_.find();
  if (!defects.empty()) without_defects(true);
  estimate_along_motion(path, ahead, deviation, crew);
  if (!defects.empty()) without_defects(false);
  for (const std::uint32_t pixel : defects) estimate_[pixel] = per_pixel_[pixel];
}

// The blocks' deviations from the whole picture's displacement. An extrapolated frame misplaces a block with its own
// motion: by its deviation for each frame extrapolated, and by the resulting excess of the innovation.
const motion::VectorField& MotionSolver::deviations(const motion::Affine& whole, Crew& crew) noexcept {
  const int target = task_.settings.lookahead;
  const Displacement& newest = displacement(target);
  const auto cap = static_cast<float>(kLargestDifference / task_.kelvin_per_value());
  const bool from_made = frame(target + 1).lost;
  const double rho = inertia_.rho;
  const double times = !from_made ? 1.0 : newest.bridged == 1 ? 2.0 + rho : 3.0 + rho * (2.0 + rho);
  if (from_made) motion::spread(whole + newest.beyond, task_.input.geometry, 1, field_);
  const motion::VectorField& found =
      local_.find(kernels_, inertia_, innovation(target + 1).smoothed, innovation(target).smoothed, field_,
                  mmae_.noise(), cap * cap, static_cast<float>(1.0 / times), crew);
  if (from_made) motion::spread(whole, task_.input.geometry, 1, field_);
  return found;
}

// Fills defects in the estimate's planes, or restores them: later displacements must depend on their own frames alone.
void MotionSolver::without_defects(bool fill) noexcept {
  std::span<float> left(covered_);
  const auto change = [&](motion::PaddedPlane& plane) {
    const std::span<float> before = left.first(defects_.most());
    left = left.subspan(before.size());
    fill ? defects_.fill(plane, before) : defects_.restore(plane, before);
  };
  for (Frame& f : frames_) {
    if (f.there) change(f.values);
  }
  change(innovation(task_.settings.lookahead).values);
}

void MotionSolver::estimate_along_motion(const motion::Path& path, bool ahead, const motion::VectorField& deviation,
                                         Crew& crew) noexcept {
  const int target = task_.settings.lookahead;
  motion::EstimateInputs in;
  in.now = &frame(target).values;
  in.innovation = &innovation(target).values;
  const int newest = ahead ? 0 : target;
  const int length = scene_length(newest);  // no cut can be detected at the end of the history
  const int of_scene = length < motion::kHistory ? newest + length : motion::kPast + target;
  for (int j = 0; j < motion::kPast; ++j) {
    Frame& past = frame(target + 1 + j);
    in.past[static_cast<std::size_t>(j)] =
        past.there && (!past.lost || j == 0) && target + j < of_scene ? &past.values : nullptr;
  }
  in.ahead = ahead ? &frame(0).values : nullptr;
  without_old_scene(newest, in, crew);
  in.path = path;
  in.bridged = displacement(target).bridged;
  in.deviation = &deviation;
  in.misfit = in.bridged > 0 ? &local_.misfit() : nullptr;
  in.row_delay = row_delay_;
  in.noise = mmae_.noise();
  in.other = per_pixel_.data();
  in.other_error = per_pixel_error_.data();
  estimators_[ahead ? 1 : 0].find(kernels_, in, crew, estimate_.data());
}

// Removes from the estimate's frames the remains of the scene before a cut.
void MotionSolver::without_old_scene(int newest, motion::EstimateInputs& in, Crew& crew) noexcept {
  const int length = scene_length(newest);
  const int base = newest + length + 1;
  if (base >= kFrames || length >= motion::kHistory) return;
  const Frame& before = frame(base);
  const Frame& first = frame(base - 1);
  if (!before.there || !first.there || before.lost || first.lost) return;
  const std::uint64_t number = taken_ - static_cast<std::uint64_t>(base);
  after_cut_.find(kernels_, inertia_, number, before.values, first.values, displacement(base - 2).motion, crew);
  const int target = task_.settings.lookahead;
  const auto without = [&](const motion::PaddedPlane*& plane, int at) {
    if (plane != nullptr && at < base) plane = &after_cut_.without_old(inertia_, *plane, base - at, crew);
  };
  without(in.now, target);
  if (in.ahead != nullptr) without(in.ahead, 0);
  for (int j = 0; j < motion::kPast; ++j) without(in.past[static_cast<std::size_t>(j)], target + 1 + j);
}

void MotionSolver::solve(const WindowView& /*window*/, const Region& part, void* out) const noexcept {
  const auto width = static_cast<std::size_t>(task_.input.geometry.width);
  for (int y = part.y; y < part.y + part.height; ++y) {
    const std::size_t begin = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(part.x);
    write(begin, static_cast<std::size_t>(part.width), begin, out);
  }
}

void MotionSolver::solve_points(const WindowView& /*window*/, std::span<const std::uint32_t> pixels,
                                void* out) const noexcept {
  for (std::size_t i = 0; i < pixels.size(); ++i) write(pixels[i], 1, i, out);
}

// Writes `count` values from `pixel` on to `out`, from value `to` on.
void MotionSolver::write(std::size_t pixel, std::size_t count, std::size_t to, void* out) const noexcept {
  const PixelRun run = run_for(task_);
  FilterRow row;
  row.columns = static_cast<int>(count);
  row.output = run.output;
  row.scale = run.scale;
  row.offset = run.offset;
  row.out = static_cast<std::byte*>(out) + to * bytes_of(run.output);
  mmae_.kernels().write(estimate_.data() + pixel, row);
}

}  // namespace bolo::deblur
