// What `bolo-lab eval detect` is asked for.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <cxxopts.hpp>

#include "src/core/geometry.hpp"
#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "tools/lab/detect/description.hpp"
#include "tools/lab/detect/labels.hpp"

namespace bolo::tools::detect {

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

// The verb's options with their help, which also says what the JSON holds. Thread: setup.
cxxopts::Options declare();

// Every wrong value is kBadInput in one line. Files are listed, and descriptions read; pictures and networks are opened
// later. Thread: setup.
Result<Options> options_of(const cxxopts::ParseResult& given);

}  // namespace bolo::tools::detect
