// `bolo-lab eval real`: recordings without a truth. How well does a sharp picture foretell what the camera measured,
// through the pixel's own equation tau dy/dt + y = x?
#include <cstdio>
#include <map>
#include <memory>
#include <numeric>

#include "src/capture/capture.hpp"
#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "src/deblur/solver.hpp"
#include "src/deblur/window.hpp"
#include "src/pipeline/convert.hpp"
#include "src/sim/path.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::real {
namespace {

constexpr const char* kSummary =
    R"(Captures without a truth: how well the blurred frame, and each solver's picture of it, foretell what the camera
measured, through the pixel's own equation tau dy/dt + y = x; root mean square, K or counts.

Two frames are foretold: the next one ("next"), and one that was left out between the two newest that the solvers saw
("left_out": they are shown every second frame). Each picture foretells it twice: as if the scene rested ("still"), and
along the motion that the solver motion found, the same for all pictures ("moved"). "only_moved" is the blurred frame
moved along and nothing else: in steady motion nothing is better, for the next frame is as blurred as this one. So
"moved" tells whether a picture is what the pixels saw, as far as the motion is right, and not how sharp it looks.

Judged are pixels in blocks of 8x8 where the two newest frames differ by more than noise, and whose prediction looks
nowhere beyond the frame: what rests is foretold by everything.

--json prints one object:
  captures  [{file, frames, frame_period_s, tau_s, unit, tasks: [{name, skipped: why} or {name, judged (frames), noise
            (as motion measured it), moving_share (of the pixels), speed_px (median of their displacement), pictures:
            {NAME: {still, moved, truth (error of the picture itself; null: not known)} or {skipped: why}}}]}])";

using Plane = std::vector<float>;  // row-major, K or counts

struct Recording {
  StreamFormat format;  // of `frames`
  std::vector<Plane> frames;
  std::vector<std::uint64_t> place;  // of each frame, periods after the first
  std::vector<Plane> truth;          // of each frame; empty where it is not known
};

// Which frame is foretold. A displacement is the scene's between two frames that solvers are shown, every `step`-th;
// the judged frame lies `ahead` displacements after the picture, and one period after a frame that they were shown.
struct Task {
  const char* name;
  int step;
  double ahead;
};
constexpr std::array kTasks{Task{"next", 1, 1.0}, Task{"left_out", 2, -0.5}};

Result<Recording> read(const std::string& file, std::size_t most_frames, double period_s) {
  ASSIGN_OR_RETURN(const auto reader, capture::CaptureReader::open(file));
  const capture::CaptureInfo& info = reader.info();
  Recording made;
  std::vector<std::byte> raw(plane_bytes(info.format.geometry, info.format.type));
  for (std::size_t i = 0; i < std::min(most_frames, info.frames); ++i) {
    RETURN_IF_ERROR(reader.read_frame(i, raw.data()));
    Plane& plane = made.frames.emplace_back(info.format.geometry.pixels());
    pipeline::convert(info.format, raw.data(), PixelType::kFloat32, plane.data(), PixelRange{0, plane.size()});
    made.place.push_back(reader.frame_id()[i] - reader.frame_id()[0]);
    if (!info.has_truth) continue;
    Plane& truth = made.truth.emplace_back(plane.size());
    RETURN_IF_ERROR(reader.read_truth(i, truth.data()));
  }
  made.format = info.format;
  made.format.type = PixelType::kFloat32;
  if (made.format.scale.unit == Unit::kKelvin) made.format.scale = {Unit::kKelvin, 1.0, 0.0};
  if (period_s > 0.0) made.format.frame_period_s = period_s;
  return made;
}

// How long ago, in periods, what a pixel shows was seen: as many ages as there are equal shares of it.
std::array<double, 16> ages_of(double periods) {
  std::array<double, 16> ages{};
  for (std::size_t i = 0; i < ages.size(); ++i) {
    const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(ages.size());
    ages[i] = -std::log1p(share * std::expm1(-periods)) / periods;
  }
  return ages;
}

struct Picture {
  std::string name;
  std::unique_ptr<deblur::Solver> solver{};  // none: the blurred frame
  std::string skipped{};                     // why there are no figures
  Plane now{};
  Plane before{};  // of the frame shown before
  SquareSum still{};
  SquareSum moved{};
  SquareSum truth{};
};

class Judge {
 public:
  Judge(const Recording& recording, double tau_s, const Task& task)
      : recording_(recording),
        task_(task),
        g_(recording.format.geometry),
        left_(std::exp(-recording.format.frame_period_s / tau_s)),
        ages_(ages_of(recording.format.frame_period_s / tau_s)) {
    settings_.tau_s = tau_s;
    settings_.period_s = recording.format.frame_period_s * task.step;
    settings_.auto_lambda = true;
    for (std::size_t i = 0; i < recording.place.size(); ++i) index_[recording.place[i]] = i;
  }

  Result<Json> run() {
    RETURN_IF_ERROR(make_pictures());
    deblur::Window window(settings_);
    deblur::Window::Ready ready;
    Progress progress(task_.name, recording_.frames.size());
    for (std::size_t i = 0; i < recording_.frames.size() && !interrupted().load(); ++i) {
      progress.update(i);
      const std::uint64_t place = recording_.place[i];
      if (place % step() != 0) continue;
      const double t_s = static_cast<double>(place) * recording_.format.frame_period_s;
      deblur::WindowFrame frame{{.frame_id = place / step(), .camera_ns = to_ns(t_s)},
                                recording_.frames[i].data(),
                                static_cast<std::uint32_t>(i)};
      window.push(frame, false);
      while (window.next(ready)) {
        if (ready.full) look(ready);
      }
    }
    if (noises_.empty()) return bad_input("no frame could be judged: too few, or the motion was not known");
    return figures();
  }

 private:
  std::uint64_t step() const { return static_cast<std::uint64_t>(task_.step); }
  // Displacements from the picture to where the scene stood `age` periods before the judged frame.
  double way(double age) const { return task_.ahead - age / task_.step; }
  std::size_t block_of(std::size_t pixel) const {
    const auto width = static_cast<std::size_t>(g_.width);
    return pixel / width / kMotionBlock * static_cast<std::size_t>(motion_blocks(g_).width) +
           pixel % width / kMotionBlock;
  }
  // Where what a pixel shows after `share` of its displacement stood in the picture.
  sim::Position source(const SceneMotion& motion, std::size_t pixel, double share) const {
    const auto width = static_cast<std::size_t>(g_.width);
    const std::size_t row = pixel / width;
    const BlockMotion& d = motion.blocks[block_of(pixel)];
    return {static_cast<double>(pixel % width) - share * static_cast<double>(d.x),
            static_cast<double>(row) - share * static_cast<double>(d.y)};
  }
  const Plane* frame_at(std::uint64_t place) const {
    const auto found = index_.find(place);
    return found == index_.end() ? nullptr : &recording_.frames[found->second];
  }

  Status make_pictures() {
    StreamFormat shown = recording_.format;
    shown.frame_period_s = settings_.period_s;
    pictures_.push_back({.name = "blurred"});
    for (const auto method :
         {deblur::Method::kInverse, deblur::Method::kAdmm, deblur::Method::kMmae, deblur::Method::kMotion}) {
      settings_.method = method;
      auto solver = deblur::Solver::create(settings_, shown, PixelType::kFloat32);
      if (!solver && method == deblur::Method::kMotion) return tl::unexpected(solver.error());
      Picture& picture = pictures_.emplace_back(Picture{.name = std::string(name(method))});
      picture.now.resize(g_.pixels());
      solver ? void(picture.solver = std::move(*solver)) : void(picture.skipped = solver.error().message);
    }
    return {};
  }

  void look(const deblur::Window::Ready& ready) {
    const std::size_t index = ready.frame.token;
    const std::uint64_t place = recording_.place[index];
    for (Picture& p : pictures_) {
      p.before = p.now;
      if (!p.solver) p.now = recording_.frames[index];
      if (!p.solver) continue;
      p.solver->prepare(ready.view);
      p.solver->solve(ready.view, {0, 0, g_.width, g_.height}, p.now.data());
    }
    const Plane* judged = frame_at(task_.ahead > 0.0 ? place + 1 : place - 1);
    const SceneMotion* motion = pictures_.back().solver->motion();
    const bool follows = place == looked_at_ + step();
    looked_at_ = place;
    if (judged == nullptr || motion == nullptr || !follows) return;
    score(*judged, *frame_at(place - step()), recording_.truth.empty() ? nullptr : &recording_.truth[index], *motion);
  }

  void score(const Plane& judged, const Plane& shown_before, const Plane* truth, const SceneMotion& motion) {
    const Plane& now = pictures_.front().now;
    const Plane& before = task_.ahead > 0.0 ? now : shown_before;
    noises_.push_back(pictures_.back().solver->noise_k());
    const double age = std::accumulate(ages_.begin(), ages_.end(), 0.0) / static_cast<double>(ages_.size());
    const double newer = std::min(1.0, 1.0 + way(age));  // a scene that rests, between two pictures
    const std::vector<bool> moves = moving_blocks(now, shown_before);
    for (std::size_t i = 0; i < now.size(); ++i) {
      if (!moves[block_of(i)] || !seen(motion, i)) continue;
      const auto moved = [&](const Plane& plane, double share) {
        const sim::Position from = source(motion, i, share);
        return static_cast<double>(sample(plane, g_, from.x_px, from.y_px));
      };
      const auto shown = [&](double x) { return std::lerp(x, static_cast<double>(before[i]), left_); };
      const auto target = static_cast<double>(judged[i]);
      for (Picture& p : pictures_) {
        double passed = 0.0;
        for (const double a : ages_) passed += moved(p.now, way(a));
        p.moved.add(shown(passed / static_cast<double>(ages_.size())), target);
        p.still.add(shown(std::lerp(static_cast<double>(p.before[i]), static_cast<double>(p.now[i]), newer)), target);
        if (truth != nullptr) p.truth.add(static_cast<double>(p.now[i]), static_cast<double>((*truth)[i]));
      }
      only_moved_.add(moved(now, task_.ahead), target);
      const BlockMotion& d = motion.blocks[block_of(i)];
      speeds_.push_back(std::hypot(d.x, d.y));
    }
    pixels_ += now.size();
  }

  // Whether what a pixel's prediction looks at lies inside the frame.
  bool seen(const SceneMotion& motion, std::size_t pixel) const {
    return std::ranges::all_of(std::array{way(0.0), way(1.0)}, [&](double share) {
      const sim::Position from = source(motion, pixel, share);
      return from.x_px >= 0.0 && from.y_px >= 0.0 && from.x_px <= g_.width - 1 && from.y_px <= g_.height - 1;
    });
  }

  // Blocks in which the two newest frames differ by more than noise.
  std::vector<bool> moving_blocks(const Plane& now, const Plane& shown_before) const {
    std::vector<SquareSum> change(motion_blocks(g_).pixels());
    for (std::size_t i = 0; i < now.size(); ++i) {
      change[block_of(i)].add(static_cast<double>(now[i]), static_cast<double>(shown_before[i]));
    }
    std::vector<bool> moves;
    moves.reserve(change.size());
    for (const SquareSum& s : change) moves.push_back(s.root_mean() > 3.0 * std::sqrt(2.0) * noises_.back());
    return moves;
  }

  Json figures() const {
    Json pictures;
    for (const Picture& p : pictures_) {
      pictures[p.name] =
          p.skipped.empty()
              ? Json{{"still", p.still.root_mean()}, {"moved", p.moved.root_mean()}, {"truth", p.truth.root_mean()}}
              : Json{{"skipped", p.skipped}};
    }
    pictures["only_moved"] = {{"moved", only_moved_.root_mean()}};
    return {{"name", task_.name},
            {"judged", noises_.size()},
            {"noise", median(noises_)},
            {"moving_share", static_cast<double>(only_moved_.count) / static_cast<double>(pixels_)},
            {"speed_px", median(speeds_)},
            {"pictures", pictures}};
  }

  const Recording& recording_;
  Task task_;
  Geometry g_;
  double left_;                  // of a frame in the next
  std::array<double, 16> ages_;  // of what a pixel saw since
  deblur::Settings settings_;
  std::map<std::uint64_t, std::size_t> index_;  // of frames by their places
  std::vector<Picture> pictures_;               // the blurred frame first, motion last
  SquareSum only_moved_;
  std::vector<double> noises_;  // a judged frame
  std::vector<float> speeds_;   // a judged pixel
  std::size_t pixels_ = 0;      // of all those frames
  std::uint64_t looked_at_ = 0;
};

Status evaluate(const cxxopts::ParseResult& given) {
  if (given.count("captures") == 0) return bad_input("CAPTURE.h5 is missing: which recordings?");
  ASSIGN_OR_RETURN(const double tau_s, number_of<double>(given, "tau", 0.0005, 1.0));
  ASSIGN_OR_RETURN(const double period_s, number_of<double>(given, "period", 0.0, 1.0));
  ASSIGN_OR_RETURN(const int frames, number_of<int>(given, "frames", deblur::Settings{}.window + 1, 100000));
  Json captures = Json::array();
  for (const std::string& file : given["captures"].as<std::vector<std::string>>()) {
    ASSIGN_OR_RETURN(const auto recording, read(file, static_cast<std::size_t>(frames), period_s));
    Json& made = captures.emplace_back(Json{{"file", file},
                                            {"frames", recording.frames.size()},
                                            {"frame_period_s", recording.format.frame_period_s},
                                            {"tau_s", tau_s},
                                            {"unit", recording.format.scale.unit == Unit::kKelvin ? "kelvin" : "count"},
                                            {"tasks", Json::array()}});
    for (const Task& task : kTasks) {
      auto judged = Judge(recording, tau_s, task).run();
      made["tasks"].push_back(judged ? std::move(*judged)
                                     : Json{{"name", task.name}, {"skipped", judged.error().message}});
    }
  }
  print_report({{"captures", captures}}, given.count("json") != 0);
  return {};
}

}  // namespace

}  // namespace bolo::tools::real

int bolo::tools::eval_real_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval real", real::kSummary);
  add_option<std::vector<std::string>>(cli, "captures", "");
  add_option<double>(cli, "tau", "thermal time constant, s", "0.011", "S");
  add_option<double>(cli, "period", "between frames, s; 0: as the captures say", "0", "S");
  add_option<int>(cli, "frames", "the most that are read of a capture", "200");
  add_option<bool>(cli, "json", "print one JSON object");
  cli.parse_positional({"captures"});
  cli.positional_help("CAPTURE.h5...");
  return run_verb("real", std::move(cli), argc, argv, real::evaluate);
}
