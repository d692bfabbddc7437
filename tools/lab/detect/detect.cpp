// `bolo-lab eval detect`: what deblurring is worth to object detectors.
#include <algorithm>
#include <cstdio>
#include <system_error>

#include "tools/cli/cli.hpp"
#include "tools/lab/detect/table.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::detect {
namespace {

constexpr const char* kSummary =
    R"(What deblurring is worth to object detectors: average precision (AP, as COCO's: IoU 0.5 to 0.95) of each
detector on sharp, blurred and deblurred frames, as in the paper.

Stills are looked at by a camera (microbolometer with tau 11 ms, 200 frames/s, 10 mK steps; black to white is 25 K) that
moves along real hand-held trajectories. All columns show the same instant. Where people labelled a still (NAME.txt
beside it, YOLO's form), their boxes, moved with the picture, are the truth; elsewhere each detector's own boxes on the
sharp frame are, so that "sharp" is 100 there by itself: two tables, never mixed. Intervals are the middle 95 % of a
bootstrap over the stills. Networks run by OpenCV; descriptions of detectors are TOML files (config/detectors).

--json prints one object:
  settings   {picture, repeats, noise_k, least_area_px2, resamples, seed, tau_s, frame_period_s, classes}
  columns    [{name, words}]
  motions    [{name, speed_px_s: {p10, p50, p90}}] at the judged instants
  rows       [{truth: labels | own_boxes, detector (null: mean over the detectors), motion, looks, stills, objects,
             columns: {NAME: {ap, ap_50, ap_75, ap_ci95, delta_ap, delta_ap_ci95, recovered, recovered_ci95,
             classes: {CLASS: {ap, objects}}}},
             bolo_over_best_baseline: {bolo, baseline, delta_ap, delta_ap_ci95}}]
AP in percent; delta_ap against "blurred"; recovered: the share of what blurring costs. What cannot be said is null.)";

using Paths = std::vector<std::filesystem::path>;

// Sorted files of a folder with one of the extensions.
Result<Paths> files_in(const std::filesystem::path& folder, const std::vector<std::string>& extensions) {
  std::error_code error;
  Paths files;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (std::ranges::find(extensions, entry.path().extension().string()) != extensions.end()) {
      files.push_back(entry.path());
    }
  }
  std::ranges::sort(files);
  if (error)
    return bad_input(folder.string() + ": cannot be opened: " + error.message() + "; name another with --data");
  if (files.empty()) return bad_input(folder.string() + ": has no file *" + extensions.front() + "; put some there");
  return files;
}

// What an option names, or else the files in a folder of --data.
Result<Paths> listed(const cxxopts::ParseResult& given, const std::string& option, const char* folder,
                     const std::vector<std::string>& extensions) {
  if (given.count(option) != 0) {
    const auto names = given[option].as<std::vector<std::string>>();
    return Paths(names.begin(), names.end());
  }
  if (given.count("data") == 0) {
    return bad_input("give --data FOLDER with " + std::string(folder) + "/*" + extensions.front() + ", or --" + option);
  }
  return files_in(std::filesystem::path(given["data"].as<std::string>()) / folder, extensions);
}

Result<std::vector<DetectorDescription>> detectors_of(const cxxopts::ParseResult& given) {
  std::filesystem::path networks;
  if (given.count("data") != 0) networks = std::filesystem::path(given["data"].as<std::string>()) / "detectors";
  if (given.count("networks") != 0) networks = given["networks"].as<std::string>();
  Paths files;
  for (const std::filesystem::path name : given["detectors"].as<std::vector<std::string>>()) {
    std::error_code ignored;
    if (!std::filesystem::is_directory(name, ignored)) {
      files.push_back(name);
      continue;
    }
    ASSIGN_OR_RETURN(const auto inside, files_in(name, {".toml"}));
    files.insert(files.end(), inside.begin(), inside.end());
  }
  std::vector<DetectorDescription> detectors;
  for (const std::filesystem::path& file : files) {
    ASSIGN_OR_RETURN(const auto description, read_description(file));
    if (std::ranges::find(detectors, description.name, &DetectorDescription::name) != detectors.end()) {
      return bad_input(file.string() + ": another detector is called '" + description.name + "' too; rename one");
    }
    ASSIGN_OR_RETURN(auto placed, with_files_in(description, networks.empty() ? file.parent_path() : networks));
    detectors.push_back(std::move(placed));
  }
  return detectors;
}

Result<Options> options_of(const cxxopts::ParseResult& given) {
  Options options;
  ASSIGN_OR_RETURN(options.scenes, listed(given, "scenes", "street", {".png", ".jpg", ".jpeg"}));
  ASSIGN_OR_RETURN(options.trajectories, listed(given, "trajectories", "trajectories", {".csv"}));
  ASSIGN_OR_RETURN(options.detectors, detectors_of(given));
  ASSIGN_OR_RETURN(options.classes, classes_of(given["classes"].as<std::string>()));
  ASSIGN_OR_RETURN(options.picture, size_of(given["size"].as<std::string>(), "size", {64, 64}, {2048, 2048}));
  ASSIGN_OR_RETURN(options.plot, plot_file_of(given));
  if (given.count("model") != 0) {
    const auto models = given["model"].as<std::vector<std::string>>();
    options.models.assign(models.begin(), models.end());
  }
  ASSIGN_OR_RETURN(options.repeats, number_of<int>(given, "repeats", 1, 100));
  ASSIGN_OR_RETURN(options.noise_k, number_of<double>(given, "noise", 0.0, 100.0));
  ASSIGN_OR_RETURN(options.least_area_px2, number_of<double>(given, "least-area", 0.0, 1e6));
  ASSIGN_OR_RETURN(options.resamples, number_of<int>(given, "resamples", 10, 100000));
  ASSIGN_OR_RETURN(options.threads, number_of<int>(given, "threads", 1, 64));
  options.seed = given["seed"].as<std::uint64_t>();
  options.json = given.count("json") != 0;
  return options;
}

Status evaluate(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const Options options, options_of(given));
  ASSIGN_OR_RETURN(const auto found, run(options));
  const Json table = table_of(found, options);
  print_report(table, options.json);
  if (options.plot.empty()) return {};
  plot::Sheet sheet = sheet_of(table, found, options);
  sheet.how = plot::format(
      "bolo-lab eval detect --size %dx%d --repeats %d --seed %llu: simulated camera, 200 frames/s, tau 11 ms, noise %g "
      "K.",
      options.picture.width, options.picture.height, options.repeats, static_cast<unsigned long long>(options.seed),
      options.noise_k);
  return save(sheet, options.plot);
}

}  // namespace

namespace {

using plot::format;
using plot::Hue;

void add_box(plot::Series& series, const Box& box) {
  const double left = box.x - 0.5;  // planes are centred on whole numbers
  const double top = box.y - 0.5;
  const double right = left + box.width;
  const double bottom = top + box.height;
  series.x.insert(series.x.end(), {left, right, right, left, left, plot::kNone});
  series.y.insert(series.y.end(), {top, top, bottom, bottom, top, plot::kNone});
}

// A frame with the boxes found in it and those that were to be found.
plot::Plot frame_of(const Found& found, const Options& options, const Exhibit& exhibit, std::size_t detector,
                    std::size_t column) {
  const Look& look = found.looks[exhibit.look];
  const double least_score = options.detectors[detector].truth_score;
  plot::Plot frame{.title = found.columns[column].title,
                   .plane = {.width = options.picture.width,
                             .height = options.picture.height,
                             .values = exhibit.frames[column],
                             .ramp = plot::Ramp::kIron,
                             .low = 0.0,
                             .high = 255.0},
                   .width = 520.0,
                   .height = 360.0};
  plot::Series wanted{.kind = plot::Kind::kLine, .hue = Hue::kWhite, .dashed = true, .width = 1.0};
  plot::Series boxes{.kind = plot::Kind::kLine, .hue = Hue::kGreen, .width = 1.5};
  const bool labelled = found.stills[look.view.still].labelled;
  for (const Truth& truth : truth_of(look, labelled, detector, least_score, found.knows[detector])) {
    if (truth.kind == TruthKind::kObject) add_box(wanted, truth.box);
  }
  for (const Detection& one : look.found[detector][column]) {
    if (one.score >= least_score) add_box(boxes, one.box);
  }
  for (plot::Series* series : {&wanted, &boxes}) {
    if (!series->x.empty()) frame.series.push_back(std::move(*series));
  }
  return frame;
}

// The detector that is surest of most boxes in the sharp frame.
std::size_t busiest_detector(const Look& look, const Options& options) {
  std::size_t best = 0;
  std::ptrdiff_t most = -1;
  for (std::size_t d = 0; d < options.detectors.size(); ++d) {
    const auto sure = [&](const Detection& one) { return one.score >= options.detectors[d].truth_score; };
    const std::ptrdiff_t boxes = std::ranges::count_if(look.found[d][kSharpColumn], sure);
    if (boxes > most) best = d;
    most = std::max(most, boxes);
  }
  return best;
}

void add_exhibit(plot::Sheet& sheet, const Found& found, const Options& options, const Exhibit& exhibit) {
  const Look& look = found.looks[exhibit.look];
  const std::size_t detector = busiest_detector(look, options);
  std::vector<plot::Plot> frames;
  for (std::size_t column = 0; column < exhibit.frames.size(); ++column) {
    frames.push_back(frame_of(found, options, exhibit, detector, column));
  }
  frames.front().caption =
      format("%s, at %.0f px/s. Green: what %s finds with a score of at least %g; dashed: what was to be found.",
             options.trajectories[look.view.motion].stem().c_str(), look.speed_px_s,
             options.detectors[detector].name.c_str(), options.detectors[detector].truth_score);
  constexpr std::size_t kBeside = 3;
  for (std::size_t i = 0; i < frames.size(); i += kBeside) {
    const auto end = frames.begin() + static_cast<std::ptrdiff_t>(std::min(i + kBeside, frames.size()));
    sheet.rows.emplace_back(frames.begin() + static_cast<std::ptrdiff_t>(i), end);
  }
}

plot::Table rows_table(const Json& table, const Found& found, const std::string& truth) {
  plot::Table shown{.caption = truth == "labels" ? "AP in percent, judged against people's labels"
                                                 : "AP in percent, judged against own boxes on the sharp frame"};
  shown.head = {"motion", "detector"};
  for (const Column& column : found.columns) shown.head.push_back(column.title);
  for (const Json& row : table["rows"]) {
    if (row["truth"] != truth) continue;
    const Json& detector = row["detector"];
    std::vector<std::string> line{row["motion"], detector.is_null() ? "mean" : detector.get<std::string>()};
    for (const Json& cell : row["columns"]) {
      const double ap = cell["ap"];
      line.push_back(std::isfinite(ap) ? format("%.1f", ap) : "-");
    }
    shown.rows.push_back(std::move(line));
  }
  return shown;
}

}  // namespace

plot::Sheet sheet_of(const Json& table, const Found& found, const Options& options) {
  plot::Sheet sheet{.title = "What deblurring is worth to object detectors"};
  for (const Exhibit& exhibit : found.exhibits) add_exhibit(sheet, found, options, exhibit);
  for (const char* truth : {"labels", "own_boxes"}) {
    plot::Table shown = rows_table(table, found, truth);
    if (!shown.rows.empty()) sheet.tables.push_back(std::move(shown));
  }
  return sheet;
}

}  // namespace bolo::tools::detect

int bolo::tools::eval_detect_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval detect", detect::kSummary);
  using Texts = std::vector<std::string>;
  const char* group = "What is looked at";
  add_option<std::string>(cli, "data",
                          "Folder with street/*.png (or .jpg), trajectories/*.csv (t_s,x_px,y_px) and the networks' "
                          "files in detectors",
                          nullptr, "FOLDER", group);
  add_option<Texts>(cli, "scenes", "These stills instead of FOLDER/street", nullptr, "IMAGE,..", group);
  add_option<Texts>(cli, "trajectories", "These motions instead of FOLDER/trajectories", nullptr, "FILE.csv,..", group);
  add_option<int>(cli, "repeats", "Looks at each still in each motion", "2", "", group);
  add_option<std::string>(
      cli, "size",
      "Pixels of the camera; 640x480 is the A655sc's whole sensor, which it cannot send 200 times a "
      "second",
      "640x480", "WxH", group);
  add_option<double>(cli, "noise", "K rms", "0.03", "", group);
  add_option<std::uint64_t>(cli, "seed", "Of looks, noise and bootstrap", "1", "", group);
  group = "Who looks";
  add_option<Texts>(cli, "detectors", "Descriptions, or folders of them", "config/detectors", "FILE.toml,..", group);
  add_option<std::string>(cli, "networks",
                          "Folder of their files instead of FOLDER/detectors; without either: where the description is",
                          nullptr, "FOLDER", group);
  add_option<Texts>(cli, "model",
                    "Learned deblurring beside the other columns: one-channel image in (0 to 1), the same out", nullptr,
                    "FILE.onnx,..", group);
  group = "How it is judged";
  add_option<std::string>(cli, "classes", "Judged classes: the label files' numbers, the detectors' names",
                          "1:person,2:bicycle,3:car", "NUMBER:NAME,..", group);
  add_option<double>(cli, "least-area", "Smaller objects are ignored, px^2", "0", "", group);
  add_option<int>(cli, "resamples", "Of the bootstrap", "1000", "", group);
  add_option<int>(cli, "threads", "The result does not depend on them", "2", "", group);
  add_option<bool>(cli, "json", "Print one JSON object");
  add_plot_option(cli, "Draw the table, and frames with their boxes");
  return run_verb("detect", std::move(cli), argc, argv, detect::evaluate);
}
