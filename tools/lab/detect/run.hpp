// Every detector on every column of every look.
#pragma once

#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/detect/columns.hpp"
#include "tools/lab/detect/options.hpp"
#include "tools/lab/detect/views.hpp"

namespace bolo::tools::detect {

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

}  // namespace bolo::tools::detect
