#include "tools/lab/detect/table.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "src/report/text.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::detect {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(); }

Json json_of(const Interval& interval) {
  return std::isfinite(interval.low) ? Json{interval.low, interval.high} : Json();
}

Json percent(double share) { return number(100.0 * share); }

Json json_of(const Cell& cell, const std::vector<JudgedClass>& classes) {
  Json json{{"ap", number(cell.ap.value)},
            {"ap_50", percent(cell.score.total.ap50)},
            {"ap_75", percent(cell.score.total.ap75)},
            {"ap_ci95", json_of(cell.ap.interval)},
            {"delta_ap", number(cell.delta.value)},
            {"delta_ap_ci95", json_of(cell.delta.interval)},
            {"recovered", number(cell.recovered.value)},
            {"recovered_ci95", json_of(cell.recovered.interval)}};
  for (std::size_t c = 0; c < cell.score.classes.size(); ++c) {
    const ClassScore& one = cell.score.classes[c];
    json["classes"][classes[c].name] = {{"ap", percent(one.ap)}, {"objects", one.objects}};
  }
  return json;
}

Json json_of(const Row& row, const Table& table, const std::vector<JudgedClass>& classes) {
  Json columns;
  for (std::size_t c = 0; c < row.cells.size(); ++c) columns[table.columns[c].name] = json_of(row.cells[c], classes);
  return {{"truth", row.labelled ? "labels" : "own_boxes"},
          {"detector", row.is_mean() ? Json() : Json(row.detector)},
          {"motion", table.motions[row.motion]},
          {"looks", row.looks},
          {"stills", row.stills},
          {"objects", row.cells.front().score.total.objects},
          {"columns", columns},
          {"bolo_over_best_baseline",
           {{"bolo", table.columns[row.contest.bolo].name},
            {"baseline", table.columns[row.contest.baseline].name},
            {"delta_ap", number(row.contest.delta.value)},
            {"delta_ap_ci95", json_of(row.contest.delta.interval)}}}};
}

std::string signed_figure(const Figure& figure) {
  if (!std::isfinite(figure.value)) return "-";
  return plot::format("%+.1f [%+.1f, %+.1f]", figure.value, figure.interval.low, figure.interval.high);
}

std::string share_figure(const Figure& figure) {
  if (!std::isfinite(figure.value)) return "-";
  return plot::format("%.0f %%", 100.0 * figure.value);
}

// Rows of one truth and motion, side by side: a line a column.
void print_block(const Table& table, const std::vector<const Row*>& rows) {
  std::printf("\n%s, %s: %d looks at %d stills\n%-12s", motion_words(table, rows.front()->motion).c_str(),
              rows.front()->labelled ? "people's labels" : "own boxes on the sharp frame", rows.front()->looks,
              rows.front()->stills, "");
  for (const Row* row : rows) {
    const std::string name = row->is_mean() ? "mean" : row->detector;
    std::printf(" | %-37s", plot::format("%s (%.0f objects)", name.c_str(), row->cells[0].score.total.objects).c_str());
  }
  std::printf("\n%-12s", "");
  for (std::size_t i = 0; i < rows.size(); ++i) std::printf(" | %5s  %-21s %7s", "AP", "against blurred", "regained");
  std::printf("\n");
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    std::printf("%-12.12s", table.columns[c].title.c_str());
    for (const Row* row : rows) {
      const Cell& cell = row->cells[c];
      const bool itself = c == kBlurredColumn;
      const std::string ap = std::isfinite(cell.ap.value) ? plot::format("%.1f", cell.ap.value) : "-";
      std::printf(" | %5s  %-21s %7s", ap.c_str(), itself ? "" : signed_figure(cell.delta).c_str(),
                  itself || c == kSharpColumn ? "" : share_figure(cell.recovered).c_str());
    }
    std::printf("\n");
  }
}

void print_contests(const Table& table) {
  std::printf("\nBolo's best column against the best baseline, AP\n");
  for (const Row& row : table.rows) {
    std::printf("  %-16s %-10s %-20s %s against %s: %s\n", table.motions[row.motion].c_str(),
                row.labelled ? "labels" : "own boxes", row.is_mean() ? "mean" : row.detector.c_str(),
                table.columns[row.contest.bolo].title.c_str(), table.columns[row.contest.baseline].title.c_str(),
                signed_figure(row.contest.delta).c_str());
  }
}

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

void add_exhibit(plot::Sheet& sheet, const Found& found, const Options& options, const Table& table,
                 const Exhibit& exhibit) {
  const Look& look = found.looks[exhibit.look];
  const std::size_t detector = busiest_detector(look, options);
  std::vector<plot::Plot> frames;
  for (std::size_t column = 0; column < exhibit.frames.size(); ++column) {
    frames.push_back(frame_of(found, options, exhibit, detector, column));
  }
  frames.front().caption =
      format("%s, at %.0f px/s. Green: what %s finds with a score of at least %g; dashed: what was to be found.",
             table.motions[look.view.motion].c_str(), look.speed_px_s, options.detectors[detector].name.c_str(),
             options.detectors[detector].truth_score);
  constexpr std::size_t kBeside = 3;
  for (std::size_t i = 0; i < frames.size(); i += kBeside) {
    const auto end = frames.begin() + static_cast<std::ptrdiff_t>(std::min(i + kBeside, frames.size()));
    sheet.rows.emplace_back(frames.begin() + static_cast<std::ptrdiff_t>(i), end);
  }
}

plot::Table rows_table(const Table& table, bool labelled) {
  plot::Table shown{.caption = labelled ? "AP in percent, judged against people's labels"
                                        : "AP in percent, judged against own boxes on the sharp frame"};
  shown.head = {"motion", "detector"};
  for (const Column& column : table.columns) shown.head.push_back(column.title);
  for (const Row& row : table.rows) {
    if (row.labelled != labelled) continue;
    std::vector<std::string> line{table.motions[row.motion], row.is_mean() ? "mean" : row.detector};
    for (const Cell& cell : row.cells) {
      line.push_back(std::isfinite(cell.ap.value) ? format("%.1f", cell.ap.value) : "-");
    }
    shown.rows.push_back(std::move(line));
  }
  return shown;
}

}  // namespace

nlohmann::ordered_json to_json(const Options& options, const Table& table) {
  Json columns = Json::array();
  for (const Column& column : table.columns) columns.push_back({{"name", column.name}, {"words", column.words}});
  Json motions = Json::array();
  for (std::size_t i = 0; i < table.motions.size(); ++i) {
    const Speeds& s = table.speeds[i];
    motions.push_back({{"name", table.motions[i]}, {"speed_px_s", {{"p10", s.p10}, {"p50", s.p50}, {"p90", s.p90}}}});
  }
  Json classes = Json::array();
  for (const JudgedClass& one : options.classes) classes.push_back(one.name);
  Json rows = Json::array();
  for (const Row& row : table.rows) rows.push_back(json_of(row, table, options.classes));
  return {{"settings",
           {{"picture", {options.picture.width, options.picture.height}},
            {"repeats", options.repeats},
            {"noise_k", options.noise_k},
            {"least_area_px2", options.least_area_px2},
            {"resamples", options.resamples},
            {"seed", options.seed},
            {"tau_s", fidelity::kTauS},
            {"frame_period_s", fidelity::kPeriodS},
            {"classes", classes}}},
          {"columns", columns},
          {"motions", motions},
          {"rows", rows}};
}

void print_text(const Options& options, const Table& table) {
  std::printf(
      "AP in percent (COCO: IoU 0.5 to 0.95), with 95 %% intervals over stills (%d draws); %dx%d pixels, noise %g K, "
      "tau 11 ms, 200 frames/s\n",
      options.resamples, options.picture.width, options.picture.height, options.noise_k);
  for (const Column& column : table.columns) std::printf("  %-12s  %s\n", column.title.c_str(), column.words.c_str());
  for (auto row = table.rows.begin(); row != table.rows.end();) {
    std::vector<const Row*> block;
    for (const auto first = row;
         row != table.rows.end() && row->motion == first->motion && row->labelled == first->labelled; ++row) {
      block.push_back(&*row);
    }
    print_block(table, block);
  }
  print_contests(table);
}

plot::Sheet sheet_of(const Table& table, const Found& found, const Options& options) {
  plot::Sheet sheet{.title = "What deblurring is worth to object detectors"};
  for (const Exhibit& exhibit : found.exhibits) add_exhibit(sheet, found, options, table, exhibit);
  for (const bool labelled : {true, false}) {
    if (plot::Table shown = rows_table(table, labelled); !shown.rows.empty()) sheet.tables.push_back(std::move(shown));
  }
  return sheet;
}

}  // namespace bolo::tools::detect
