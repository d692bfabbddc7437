// Every detector on every column of every look.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/geometry.hpp"
#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/report/sheet.hpp"
#include "tools/lab/detect/average_precision.hpp"
#include "tools/lab/detect/description.hpp"
#include "tools/lab/detect/views.hpp"

namespace bolo::tools::detect {

// What `bolo-lab eval detect` is asked for.
struct Options {
  std::vector<std::filesystem::path> scenes;
  std::vector<std::filesystem::path> trajectories;
  std::vector<DetectorDescription> detectors;  // with their files' places
  std::vector<std::filesystem::path> models;   // learned deblurring, ONNX
  std::vector<JudgedClass> classes;
  Geometry picture{640, 480};
  int repeats = 2;
  double noise_k = 0.03;
  double least_area_px2 = 0.0;
  int resamples = 1000;
  std::uint64_t seed = 1;
  int threads = 2;
  OutputFile plot;  // empty: none
  bool json = false;
};

// What was found in one look.
struct Look {
  View view;
  double speed_px_s = 0.0;    // of the picture over the pixels, at the judged instant
  std::vector<Truth> labels;  // people's boxes as the look shows them; empty when the still has none
  std::vector<std::vector<std::vector<Detection>>> found;  // [detector][column]
  std::vector<std::string> settings;                       // of each column
};

// A look as it is drawn: the frame of each column.
struct Exhibit {
  std::size_t look = 0;
  std::vector<Levels> frames;
};

struct Found {
  std::vector<Still> stills;
  std::vector<Column> columns;           // own_columns() and the learned ones
  std::vector<std::vector<bool>> knows;  // [detector][class]
  std::vector<Look> looks;
  std::vector<Exhibit> exhibits;  // one a motion, when a plot is asked for
};

// Opens stills and networks, simulates, restores, detects. kBadInput names what cannot be opened or run, kFailed an
// interrupt. Thread: setup.
Result<Found> run(const Options& options);

// --- What deblurring is worth to detectors: AP of every column, against the blurred one, with intervals.

// Percent, or a share; NaN where it cannot be said.
struct Figure {
  double value = kNoScore;
  Interval interval{kNoScore, kNoScore};
};

struct Cell {
  ApScore score;     // of one detector; of several, the means
  Figure ap;         // percent
  Figure delta;      // against blurred, percent points
  Figure recovered;  // (AP - blurred) / (sharp - blurred)
};

// Who won: Bolo's best column against the best of the baselines and learned models.
struct Contest {
  std::size_t bolo = 0;  // columns
  std::size_t baseline = 0;
  Figure delta;  // Bolo's AP less the baseline's, percent points
};

// One detector in one motion, or the mean of all detectors there.
struct Row {
  bool labelled = false;  // judged against people's labels; else against the detector's own boxes on the sharp frame
  std::string detector;   // empty: the mean
  std::size_t motion = 0;
  int looks = 0;
  int stills = 0;
  std::vector<Cell> cells;  // one a column
  Contest contest;

  bool is_mean() const { return detector.empty(); }
};

struct Speeds {
  double p10 = 0.0;
  double p50 = 0.0;
  double p90 = 0.0;
};

struct Table {
  std::vector<Column> columns;
  std::vector<std::string> motions;
  std::vector<Speeds> speeds;  // of the motions, px/s
  std::vector<Row> rows;       // labelled ones first; motions from slow to fast, detectors as given, then their mean
};

// Thread: any.
Table table_of(const Found& found, const Options& options);

// "slow_indoor (median 118 px/s)". Thread: any.
std::string motion_words(const Table& table, std::size_t motion);

// What a detector had to find in a look: people's labels of classes that it knows, or, where there are none, its own
// boxes on the sharp frame from `truth_score` on. Thread: any.
std::vector<Truth> truth_of(const Look& look, bool labelled, std::size_t detector, double truth_score,
                            const std::vector<bool>& knows);

// --- The result of `bolo-lab eval detect`, as text and as JSON.

// The schema is in the verb's --help. Thread: any.
nlohmann::ordered_json to_json(const Options& options, const Table& table);

// To stdout. Thread: one at a time.
void print_text(const Options& options, const Table& table);

// For each motion one look as the columns show it, with the boxes that one detector found; a page has the table, too.
// Thread: any.
plot::Sheet sheet_of(const Table& table, const Found& found, const Options& options);

}  // namespace bolo::tools::detect
