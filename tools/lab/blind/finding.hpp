// What a report says, as far as the score needs it.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::tools::blind {

struct Interval {
  double value = 0.0;
  double low = 0.0;
  double high = 0.0;
};

struct Named {
  std::string name;
  double confidence = 0.0;
  std::map<std::string, Interval> parameters;
  std::vector<std::string> alternatives;
};

struct Finding {
  std::string verdict;
  std::vector<Named> effects;  // in the order of the report
  std::string unexplained_stage;
  std::string location_stage;
  double gap_before = 0.0;  // of the residual, or of the noise's own statistics where that is larger
  double gap_after = 0.0;
  double seconds = 0.0;
};

// Reads a report.json. kFailed when it is none. Thread: any.
Result<Finding> read_finding(const std::filesystem::path& file);
Result<Finding> parse_finding(const std::string& text);

}  // namespace bolo::tools::blind
