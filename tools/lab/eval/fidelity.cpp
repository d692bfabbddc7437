// `bolo-lab eval fidelity`: which estimator is good where.

#include <algorithm>
#include <cstdio>

#include "src/sim/field.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/eval/fidelity.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr const char* kSummary =
    R"(Which estimator is good where: RMSE, as it is and after the best shift of each frame (which takes out lag), noise
in flat tiles, PSNR, SSIM, edge width and the error at edges of every column in every cell.

A cell is a scene, a motion, a noise and a look-ahead. All columns see the same simulated frames (microbolometer with
tau 11 ms, 200 frames/s, 10 mK steps) and are judged on the same targets against the instantaneous temperature at the
frame's time. Spatial baselines are told the motion; strengths named "picked" are picked with the truth. The temporal
filter is a least-squares fit on another street in the same motion and noise.

--json prints one object:
  settings   crop, frames, stride, seed, tau_s, frame_period_s, window, quantisation_k, range_k (of PSNR and SSIM)
  columns    [{name, words}]
  cells      [{scene, motion, speed_px_s (null on a trajectory), trajectory (null on a pan), noise_k, lookahead,
             truth_edge_width_px, columns: {NAME: {rmse_k, psnr_db, ssim, edge_width_px, edge_rmse_k,
             shifted_rmse_k, flat_noise_k, setting} or {skipped: why}}, qp_grid: [{lambda, rmse_k}]}]
  drops      with --drop: [{scene, motion, noise_k, lookahead, method, frames_lost, all, near}], or skipped: why;
             all and near (at most 2 frames from a loss) are {frames, whole_rmse_k (without losses),
             gap_aware_rmse_k, gap_blind_rmse_k}
  latency    with --plot: [{scene, motion, noise_k, blurred_rmse_k, lookaheads, NAME: [rmse_k]}]
  verdicts   [{name, words, cells, holds, mean_ratio, worst_ratio, misses: [{cell, against, ratio}]}]; holds is null
             where no cell could be judged
A measure that cannot be taken (no clear edge) is null.)";

template <typename T>
Status all_within(const std::vector<T>& values, const char* option, T low, T high) {
  if (values.empty()) return bad_input(std::string("--") + option + ": expected at least one value");
  for (const T value : values) {
    const auto number = static_cast<double>(value);
    if (Status good = within(number, option, static_cast<double>(low), static_cast<double>(high)); !good) return good;
  }
  auto sorted = values;
  std::ranges::sort(sorted);
  if (std::ranges::adjacent_find(sorted) != sorted.end()) {
    return bad_input(std::string("--") + option + ": a value is given twice");
  }
  return {};
}

Result<std::vector<std::string>> scenes_of(const cxxopts::ParseResult& given) {
  auto scenes = given["scene"].as<std::vector<std::string>>();
  for (const std::string& scene : scenes) {
    if (scene == "street") continue;
    RETURN_IF_ERROR(sim::read_image(scene, {}));
  }
  return scenes;
}

Result<std::vector<Motion>> motions_of(const cxxopts::ParseResult& given) {
  const auto speeds = given["speeds"].as<std::vector<double>>();
  RETURN_IF_ERROR(all_within(speeds, "speeds", -5000.0, 5000.0));
  std::vector<Motion> motions;
  motions.reserve(speeds.size());
  for (const double speed : speeds) motions.push_back({speed, {}});
  if (given.count("trajectory") == 0) return motions;
  for (const std::string& file : given["trajectory"].as<std::vector<std::string>>()) {
    RETURN_IF_ERROR(sim::read_trajectory(file));
    motions.push_back({0.0, file});
  }
  return motions;
}

constexpr std::uint64_t kOtherStreet = 1000;  // away from the seeds of the judged street and noise: the training's
constexpr int kLongestLookahead = 4;          // of the picture of latency against quality
constexpr int kDropTargets = 720;             // frames of the streams with losses
constexpr int kDropRows = 16;

class Evaluation {
 public:
  explicit Evaluation(const Options& options)
      : options_(options),
        longest_(*std::ranges::max_element(options.lookaheads)),
        progress_("fidelity", options.scenes.size() * options.motions.size() * jobs_a_motion()) {}

  Result<Json> run() {
    table_["cells"] = Json::array();
    for (const std::string& scene : options_.scenes) {
      for (const Motion& motion : options_.motions) RETURN_IF_ERROR(run_motion(scene, motion));
    }
    table_["verdicts"] = verdicts(table_["cells"], table_.value("drops", Json::array()));
    return std::move(table_);
  }

 private:
  // Everything at one noise.
  struct Noise {
    Sequence sequence;
    Sequence training;
    Sequence lossy;
    Json spatial;
    std::vector<Json> cells;
    std::vector<Json> drops;
    Json latency;
  };

  std::uint64_t jobs_a_motion() const {
    const std::uint64_t lookaheads = options_.lookaheads.size();
    return options_.noises_k.size() * (2 + lookaheads * (options_.drop > 0.0 ? 2 : 1));
  }

  // The picture shows one motion's latency: the pan nearest to the paper's, over the first scene.
  bool shows_latency(const std::string& scene, const Motion& motion) const {
    constexpr double kShownSpeed = 300.0;
    const auto distance = [](const Motion& m) { return m.is_pan() ? std::abs(m.speed_px_s - kShownSpeed) : 1e9; };
    const auto nearest = std::ranges::min_element(options_.motions, {}, distance);
    return !options_.plot.empty() && scene == options_.scenes.front() && &*nearest == &motion;
  }

  SequenceTask task_of(const std::string& scene, const Motion& motion) const {
    SequenceTask task{scene,    motion,        options_.crop,   options_.frames, stride_of(motion),
                      longest_, options_.seed, options_.threads};
    if (shows_latency(scene, motion)) task.lookahead = std::max(longest_, kLongestLookahead);
    return task;
  }

  Status run_motion(const std::string& scene, const Motion& motion) {
    const SequenceTask task = task_of(scene, motion);
    SequenceTask other = task;
    other.scene = "street";
    other.seed = options_.seed + kOtherStreet;
    SequenceTask lossy = task;
    lossy.targets = kDropTargets;
    lossy.stride = 1;
    lossy.crop.height = std::min(lossy.crop.height, kDropRows);
    ASSIGN_OR_RETURN(const auto clean, simulate(task));
    ASSIGN_OR_RETURN(const auto training, simulate(other));
    ASSIGN_OR_RETURN(const auto stream, options_.drop > 0.0 ? simulate(lossy) : CleanSequence{});
    std::vector<Noise> noises(options_.noises_k.size());
    Jobs jobs;
    for (std::size_t n = 0; n < noises.size(); ++n) {
      jobs.add([&, n]() -> Status {
        const double noise_k = options_.noises_k[n];
        noises[n].sequence = read_out(clean, noise_k, options_.seed);
        noises[n].training = read_out(training, noise_k, options_.seed + kOtherStreet);
        if (options_.drop > 0.0) noises[n].lossy = read_out(stream, noise_k, options_.seed);
        return {};
      });
    }
    RETURN_IF_ERROR(jobs.run(options_.threads, progress_, done_));
    for (Noise& noise : noises) add_jobs(jobs, noise, shows_latency(scene, motion));
    RETURN_IF_ERROR(jobs.run(options_.threads, progress_, done_));
    for (Noise& noise : noises) collect(noise);
    return {};
  }

  void add_jobs(Jobs& jobs, Noise& noise, bool latency) {
    noise.cells.resize(options_.lookaheads.size());
    noise.drops.resize(options_.lookaheads.size());
    jobs.add(keep(noise.spatial, [&noise] { return Result<Json>(spatial_columns(noise.sequence)); }));
    if (latency) {
      jobs.add(
          keep(noise.latency, [&noise] { return Result<Json>(latency_curves(noise.sequence, kLongestLookahead)); }));
    }
    for (std::size_t l = 0; l < options_.lookaheads.size(); ++l) {
      const int lookahead = options_.lookaheads[l];
      jobs.add(
          keep(noise.cells[l], [&noise, lookahead] { return evaluate(noise.sequence, noise.training, lookahead); }));
      if (options_.drop <= 0.0) continue;
      jobs.add(keep(noise.drops[l], [this, &noise, lookahead] {
        return Result<Json>(drop_rows(noise.lossy, lookahead, options_.drop, options_.seed));
      }));
    }
  }

  void collect(Noise& noise) {
    for (Json& cell : noise.cells) {
      Json columns;
      cell["columns"].update(noise.spatial);
      for (const Column& column : kColumns) columns[column.name] = cell["columns"][column.name];
      cell["columns"] = columns;
      table_["cells"].push_back(std::move(cell));
    }
    for (const Json& rows : noise.drops) {
      for (const Json& row : rows) table_["drops"].push_back(row);
    }
    if (!noise.latency.is_null()) table_["latency"].push_back(noise.latency);
  }

  const Options& options_;
  int longest_;
  Progress progress_;
  std::uint64_t done_ = 0;
  Json table_;
};

Result<Options> options_of(const cxxopts::ParseResult& given) {
  Options options;
  ASSIGN_OR_RETURN(options.scenes, scenes_of(given));
  ASSIGN_OR_RETURN(options.motions, motions_of(given));
  ASSIGN_OR_RETURN(options.crop, size_of(given["crop"].as<std::string>(), "crop", {32, 16}, {4096, 4096}));
  options.noises_k = given["noises"].as<std::vector<double>>();
  options.lookaheads = given["lookaheads"].as<std::vector<int>>();
  options.seed = given["seed"].as<std::uint64_t>();
  options.json = given.count("json") != 0;
  ASSIGN_OR_RETURN(options.plot, plot_file_of(given));
  RETURN_IF_ERROR(all_within(options.noises_k, "noises", 0.0, 100.0));
  RETURN_IF_ERROR(all_within(options.lookaheads, "lookaheads", 0, kWindow - 2));
  ASSIGN_OR_RETURN(options.frames, number_of<int>(given, "frames", 1, 1000));
  ASSIGN_OR_RETURN(options.threads, number_of<int>(given, "threads", 1, 64));
  if (given.count("drop") != 0) {
    ASSIGN_OR_RETURN(options.drop, number_of<double>(given, "drop", 0.0001, 0.5));
  }
  return options;
}

Status run(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const Options options, options_of(given));
  ASSIGN_OR_RETURN(const Json table, Evaluation(options).run());
  Json whole = head_of(options);
  whole.update(table);
  print_report(whole, options.json);
  if (options.plot.empty()) return {};
  plot::Sheet sheet = sheet_of(table);
  sheet.how = plot::format(
      "bolo-lab eval fidelity --frames %d --crop %dx%d --seed %llu: simulated camera, 200 frames/s, tau 11 ms.",
      options.frames, options.crop.width, options.crop.height, static_cast<unsigned long long>(options.seed));
  return save(sheet, options.plot);
}

}  // namespace

}  // namespace bolo::tools::fidelity

int bolo::tools::eval_fidelity_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval fidelity", fidelity::kSummary);
  using Texts = std::vector<std::string>;
  using Numbers = std::vector<double>;
  add_option<Texts>(cli, "scene", "street, or pictures: PNG, JPEG (black to white is 25 K), HDF5 with image_k",
                    "street", "street|IMAGE,..");
  add_option<Numbers>(cli, "speeds", "Pans along +x, pixels/s", "100,300,600");
  add_option<Texts>(cli, "trajectory",
                    "Hand-held motions beside the pans, from the middle of each file: CSV of t_s,x_px,y_px", nullptr,
                    "FILE.csv,..");
  add_option<Numbers>(cli, "noises", "K rms", "0.03,0.1,0.5");
  add_option<std::vector<int>>(cli, "lookaheads", "Frames", "0,1,2");
  add_option<int>(cli, "frames", "Targets judged in a cell", "24");
  add_option<std::string>(cli, "crop", "Pixels judged", "320x64", "WxH");
  add_option<double>(cli, "drop", "Also lose this share of the frames, at random", nullptr, "SHARE");
  add_option<std::uint64_t>(cli, "seed", "Of the street, the noise and the losses", "1");
  add_option<int>(cli, "threads", "The result does not depend on them", "2");
  add_option<bool>(cli, "json", "Print one JSON object");
  add_plot_option(cli, "Draw the table");
  return run_verb("fidelity", std::move(cli), argc, argv, fidelity::run);
}
