// The table of `bolo-lab eval fidelity`: what it says about the estimators, as text, JSON and a picture.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/output_file.hpp"
#include "src/report/sheet.hpp"
#include "tools/lab/eval/fidelity_columns.hpp"

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
std::string label_of(const Place& place);

// --- The result of `bolo-lab eval fidelity`, as text and as JSON.

// What `bolo-lab eval fidelity` is asked for.
struct Options {
  std::vector<std::string> scenes;
  std::vector<Motion> motions;  // pans, then trajectories
  std::vector<double> noises_k;
  std::vector<int> lookaheads;
  int frames = 24;
  Geometry crop{320, 64};
  double drop = 0.0;  // share of frames lost; 0: that part is left out
  std::uint64_t seed = 1;
  int threads = 2;
  OutputFile plot;  // empty: none
  bool json = false;
};

struct Table {
  std::vector<Cell> cells;
  std::vector<DropRow> drops;
  std::vector<LatencyCurves> latency;
  std::vector<Verdict> verdicts;
};

// From one target to the next, in frames: pans show another part of the scene, hands change their speed slowly.
inline int stride_of(const Motion& motion) { return motion.is_pan() ? 3 : 8; }

// The schema is in the verb's --help.
nlohmann::ordered_json to_json(const Options& options, const Table& table);

void print_text(const Options& options, const Table& table);

// RMSE over look-ahead; then for each scene and look-ahead the RMSE of each estimator relative to the blurred input.
// Thread: any.
plot::Sheet sheet_of(const Table& table);

}  // namespace bolo::tools::fidelity
