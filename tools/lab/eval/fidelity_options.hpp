// What `bolo-lab eval fidelity` is asked for.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <cxxopts.hpp>

#include "src/core/geometry.hpp"
#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {

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

// The verb's options with their help, which also says what the JSON holds.
cxxopts::Options declare();

// Every wrong value is kBadInput in one line; scenes and trajectories are opened once to see whether they can be read.
Result<Options> options_of(const cxxopts::ParseResult& given);

}  // namespace bolo::tools::fidelity
