#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/lab/detect/table.hpp"

namespace bolo::tools::detect {
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

std::string detector_of(const Json& row) {
  return row["detector"].is_null() ? "mean" : row["detector"].get<std::string>();
}

const std::vector<TextColumn> kContest{{"Bolo's", -12, "bolo"},
                                       {"against", -15, "baseline"},
                                       {"points", 7, "delta_ap", "%+.1f"},
                                       {"from", 6, "delta_ap_ci95/0", "%+.1f"},
                                       {"to", 6, "delta_ap_ci95/1", "%+.1f"}};
const std::vector<TextColumn> kCell{{"", -12, "title"},
                                    {"AP", 6, "ap", "%.1f"},
                                    {"against blurred", 15, "delta_ap", "%+.1f"},
                                    {"from", 6, "delta_ap_ci95/0", "%+.1f"},
                                    {"to", 6, "delta_ap_ci95/1", "%+.1f"},
                                    {"regained", 8, "recovered", "%.0f %%", 100.0}};

plot::Table rows_table(const Json& table, const Found& found, const std::string& truth) {
  plot::Table shown{.caption = truth == "labels" ? "AP in percent, judged against people's labels"
                                                 : "AP in percent, judged against own boxes on the sharp frame"};
  shown.head = {"motion", "detector"};
  for (const Column& column : found.columns) shown.head.push_back(column.title);
  for (const Json& row : table["rows"]) {
    if (row["truth"] != truth) continue;
    std::vector<std::string> line{row["motion"].get<std::string>(), detector_of(row)};
    for (const Json& cell : row["columns"])
      line.push_back(line_of(std::vector<TextColumn>{{"", 0, "ap", "%.1f"}}, cell));
    shown.rows.push_back(std::move(line));
  }
  return shown;
}

}  // namespace

void print_text(const Options& options, const Found& found, const Json& table) {
  std::printf(
      "AP in percent (COCO: IoU 0.5 to 0.95), with 95 %% intervals over stills (%d draws); %dx%d pixels, noise %g K, "
      "tau 11 ms, 200 frames/s\n",
      options.resamples, options.picture.width, options.picture.height, options.noise_k);
  for (const Column& column : found.columns) std::printf("  %-12s  %s\n", column.title.c_str(), column.words.c_str());
  for (const Json& motion : table["motions"]) {
    std::printf("%s: median %.0f px/s\n", motion["name"].get<std::string>().c_str(),
                motion["speed_px_s"]["p50"].get<double>());
  }
  for (const Json& row : table["rows"]) {
    std::printf("\n%s, %s, %s: %d looks at %d stills, %.0f objects\n%s\n", row["motion"].get<std::string>().c_str(),
                row["truth"] == "labels" ? "people's labels" : "own boxes on the sharp frame", detector_of(row).c_str(),
                row["looks"].get<int>(), row["stills"].get<int>(), row["objects"].get<double>(),
                line_of(kCell).c_str());
    for (const Column& column : found.columns) {
      Json cell = row["columns"][column.name];
      cell["title"] = column.title;
      std::puts(line_of(kCell, cell).c_str());
    }
    std::printf("best column, AP\n%s\n%s\n", line_of(kContest).c_str(),
                line_of(kContest, row["bolo_over_best_baseline"]).c_str());
  }
}

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
