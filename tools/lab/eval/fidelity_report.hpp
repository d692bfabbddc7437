// The result of `bolo-lab eval fidelity`, as text and as JSON.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/lab/eval/fidelity_columns.hpp"
#include "tools/lab/eval/fidelity_drops.hpp"
#include "tools/lab/eval/fidelity_options.hpp"
#include "tools/lab/eval/fidelity_verdicts.hpp"

namespace bolo::tools::fidelity {

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

}  // namespace bolo::tools::fidelity
