// What deblurring is worth to detectors: AP of every column, against the blurred one, with intervals.
#pragma once

#include <string>
#include <vector>

#include "tools/lab/detect/average_precision.hpp"
#include "tools/lab/detect/bootstrap.hpp"
#include "tools/lab/detect/run.hpp"

namespace bolo::tools::detect {

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

}  // namespace bolo::tools::detect
