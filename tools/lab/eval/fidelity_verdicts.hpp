// What the table says about the estimators, computed from it.
#pragma once

#include <string>
#include <vector>

#include "tools/lab/eval/fidelity_columns.hpp"
#include "tools/lab/eval/fidelity_drops.hpp"

namespace bolo::tools::fidelity {

// One cell that misses, and by what: the ratio of two RMSE.
struct Miss {
  std::string cell;     // "street, 300 px/s, noise 0.1 K, look-ahead 1"
  std::string against;  // the column it is compared with
  double ratio = 0.0;
};

struct Verdict {
  std::string name;   // in JSON
  std::string words;  // what is asked for
  int cells = 0;      // that could be judged; 0: the column is not there
  std::vector<Miss> misses;
  double mean_ratio = 0.0;   // geometric, over the cells
  double worst_ratio = 0.0;  // the highest

  bool holds() const { return cells > 0 && misses.empty(); }
};

// Rows of cells in any order; look-ahead pairs and lost frames are judged when they are there. Thread: any.
std::vector<Verdict> verdicts(const std::vector<Cell>& cells, const std::vector<DropRow>& drops);

// Thread: any.
std::string label_of(const Cell& cell);

}  // namespace bolo::tools::fidelity
