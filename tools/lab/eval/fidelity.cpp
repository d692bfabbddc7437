// `bolo-lab eval fidelity`: compares the estimators.

#include <algorithm>
#include <map>
#include <mutex>

#include "src/core/statistics.hpp"
#include "src/sim/field.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/eval/fidelity.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr const char* kSummary =
    R"(Which estimator is good where: the RMSE of every column in every cell, as it is and after the best shift of each
frame (which takes out lag), edges' width from 10 to 90 %, and the noise in flat tiles.

A cell is a scene, a motion, a noise and a look-ahead. All columns see the same simulated frames (microbolometer with
tau 11 ms, 200 frames/s, 10 mK steps) and are judged on the same targets against the instantaneous temperature at the
frame's time. The spatial Wiener filter is told the motion, or 10 % too much of it; its strength and the QP's best
lambda ("setting") are picked with the truth.

--json prints one object:
  settings   crop, frames, stride, seed
  columns    [{name, words}]
  cells      [{scene, motion, noise_k, lookahead, truth_edge_width_px, columns: {NAME: {rmse_k, edge_width_px,
             shifted_rmse_k, flat_noise_k, setting} or {skipped: why}}}]
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

struct Options {
  std::vector<std::string> scenes;
  std::vector<Motion> motions;  // pans, then trajectories
  std::vector<double> noises_k;
  std::vector<int> lookaheads;
  int frames = 24;
  Geometry crop{320, 64};
  std::uint64_t seed = 1;
  int threads = 2;
  OutputFile plot;  // empty: no plot
};

// Frames between targets: pans show new parts of the scene, hands change their speed slowly.
int stride_of(const Motion& motion) { return motion.is_pan() ? 3 : 8; }

Json figures_of(const Planes& planes, const Planes& truth, const Sequence& s) {
  return measure(planes, truth, {s.clean->judged.width, s.clean->judged.height});
}

Json picked_figures(const Oracle& oracle, const Planes& truth, const Sequence& s) {
  Json figures = figures_of(oracle.planes(), truth, s);
  figures["setting"] = oracle.setting();
  return figures;
}

// The trail at each target for its velocity times `factor`.
std::vector<std::vector<Tap>> motion_kernels(const CleanSequence& clean, double factor) {
  return mapped(clean.content_v, [factor](sim::Position v) {
    return motion_kernel({factor * v.x_px, factor * v.y_px}, kTauS);
  });
}

// The QP at every lambda of the grid.
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

// Columns of single-frame estimators, which do not depend on the look-ahead.
Json spatial_columns(const Sequence& s) {
  const Planes truth = target_truth(*s.clean);
  const auto wiener = [&](double factor) {
    Oracle oracle(truth);
    try_wiener(s, motion_kernels(*s.clean, factor), oracle);
    return picked_figures(oracle, truth, s);
  };
  return {{"spatial_wiener", wiener(1.0)}, {"spatial_wiener_10", wiener(kWrongSpeed)}};
}

// The cell for one look-ahead, without the spatial columns.
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
    const auto planes = estimate(s, settings);  // motion takes no look-ahead above 1
    columns[name] = planes ? figures_of(*planes, truth, s) : Json{{"skipped", planes.error().message}};
  }
  return Json{{"scene", s.clean->task.scene},
              {"motion", s.clean->task.motion.label()},
              {"noise_k", s.noise_k},
              {"lookahead", lookahead},
              {"truth_edge_width_px", edge_width(truth, truth, s.clean->task.crop)},
              {"columns", std::move(columns)}};
}

class Evaluation {
 public:
  explicit Evaluation(const Options& options)
      : options_(options),
        progress_("fidelity", options.scenes.size() * options.motions.size() * options.noises_k.size() *
                                  (1 + options.lookaheads.size())) {}

  Result<Json> run() {
    for (const std::string& scene : options_.scenes) {
      for (const Motion& motion : options_.motions) RETURN_IF_ERROR(run_motion(scene, motion));
    }
    return std::move(cells_);
  }

 private:
  Status run_motion(const std::string& scene, const Motion& motion) {
    const int longest = *std::ranges::max_element(options_.lookaheads);
    ASSIGN_OR_RETURN(const auto clean, simulate({scene, motion, options_.crop, options_.frames, stride_of(motion),
                                                 longest, options_.seed, options_.threads}));
    std::vector<Sequence> sequences;
    for (const double noise_k : options_.noises_k) sequences.push_back(read_out(clean, noise_k, options_.seed));
    std::vector<Json> spatial(sequences.size());
    std::vector<Json> cells(sequences.size() * options_.lookaheads.size());
    Jobs jobs;
    for (std::size_t n = 0; n < sequences.size(); ++n) {
      const Sequence& sequence = sequences[n];
      jobs.add(keep(spatial[n], [&sequence] { return Result<Json>(spatial_columns(sequence)); }));
      for (std::size_t l = 0; l < options_.lookaheads.size(); ++l) {
        jobs.add(keep(cells[n * options_.lookaheads.size() + l],
                      [&sequence, lookahead = options_.lookaheads[l]] { return evaluate(sequence, lookahead); }));
      }
    }
    RETURN_IF_ERROR(jobs.run(options_.threads, progress_, done_));
    for (std::size_t i = 0; i < cells.size(); ++i) {
      cells[i]["columns"].update(spatial[i / options_.lookaheads.size()]);
      cells_.push_back(std::move(cells[i]));
    }
    return {};
  }

  const Options& options_;
  Progress progress_;
  std::uint64_t done_ = 0;
  Json cells_ = Json::array();
};

Result<Options> options_of(const cxxopts::ParseResult& given) {
  Options options;
  ASSIGN_OR_RETURN(options.scenes, scenes_of(given));
  ASSIGN_OR_RETURN(options.motions, motions_of(given));
  ASSIGN_OR_RETURN(options.crop, size_of(given["crop"].as<std::string>(), "crop", {32, 16}, {4096, 4096}));
  options.noises_k = given["noises"].as<std::vector<double>>();
  options.lookaheads = given["lookaheads"].as<std::vector<int>>();
  options.seed = given["seed"].as<std::uint64_t>();
  ASSIGN_OR_RETURN(options.plot, plot_file_of(given));
  RETURN_IF_ERROR(all_within(options.noises_k, "noises", 0.0, 100.0));
  RETURN_IF_ERROR(all_within(options.lookaheads, "lookaheads", 0, kWindow - 2));
  ASSIGN_OR_RETURN(options.frames, number_of<int>(given, "frames", 1, 1000));
  ASSIGN_OR_RETURN(options.threads, number_of<int>(given, "threads", 1, 64));
  return options;
}

Json settings_json(const Options& options) {
  return {{"crop", {options.crop.width, options.crop.height}},
          {"frames", options.frames},
          {"stride", {{"pan", stride_of({})}, {"trajectory", stride_of({0.0, "any"})}}},
          {"seed", options.seed}};
}

Status run(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const Options options, options_of(given));
  ASSIGN_OR_RETURN(const Json cells, Evaluation(options).run());
  const Json columns = list_of(kColumns, [](const Column& c) { return Json{{"name", c.name}, {"words", c.words}}; });
  print_report({{"settings", settings_json(options)}, {"columns", columns}, {"cells", cells}},
               given.count("json") != 0);
  if (options.plot.empty()) return {};
  plot::Sheet sheet = sheet_of(cells);
  sheet.how = plot::format(
      "bolo-lab eval fidelity --frames %d --crop %dx%d --seed %llu: simulated camera, 200 frames/s, tau 11 ms.",
      options.frames, options.crop.width, options.crop.height, static_cast<unsigned long long>(options.seed));
  return save(sheet, options.plot);
}

// RMSE over latency for the cells with one noise level.
plot::Plot panel_of(const std::vector<Json>& cells) {
  const Json& first = cells.front();
  plot::Plot panel{.title = plot::format("Noise %g K", first["noise_k"].get<double>()),
                   .x = {.name = "added latency", .unit = "ms", .low = 0.0},
                   .y = {.name = "RMSE", .unit = "K", .low = 0.0},
                   .levels = {{first["columns"]["blurred"]["rmse_k"], "blurred", plot::Hue::kBlurred}},
                   .width = 400.0,
                   .height = 230.0};
  for (const Column& column : kColumns) {
    if (!column.hue) continue;
    plot::Series line{.label = column.words, .hue = *column.hue, .width = column.width};
    for (const Json& cell : cells) {
      line.x.push_back(cell["lookahead"].get<int>() * kPeriodS * 1e3);
      line.y.push_back(cell["columns"][column.name].value("rmse_k", plot::kNone));
    }
    panel.series.push_back(std::move(line));
  }
  return panel;
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
    static std::mutex one_at_a_time;  // set-up is not thread-safe
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

plot::Sheet sheet_of(const Json& cells) {
  plot::Sheet sheet{.title = "Which estimator is good where"};
  std::map<std::pair<std::string, std::string>, std::map<double, std::vector<Json>>> rows;
  for (const Json& cell : cells) {
    rows[{std::filesystem::path(cell["scene"].get<std::string>()).stem().string(), cell["motion"]}]
        [cell["noise_k"].get<double>()]
            .push_back(cell);
  }
  for (const auto& [place, noises] : rows) {
    std::vector<plot::Plot>& panels = sheet.rows.emplace_back();
    for (const auto& [noise_k, of_noise] : noises) panels.push_back(panel_of(of_noise));
    panels.front().caption = "Error over latency: " + place.first + ", " + place.second +
                             ". What it is worth to wait for frames after the one that is estimated.";
  }
  return sheet;
}

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
  add_option<std::uint64_t>(cli, "seed", "Of the street and the noise", "1");
  add_option<int>(cli, "threads", "The result does not depend on them", "2");
  add_option<bool>(cli, "json", "Print one JSON object");
  add_plot_option(cli, "Draw the errors over latency");
  return run_verb("fidelity", std::move(cli), argc, argv, fidelity::run);
}
