// Which pictures the detectors are given: stills, each seen several times by a camera in somebody's hands.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "src/sim/path.hpp"
#include "tools/lab/detect/boxes.hpp"
#include "tools/lab/detect/detector.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::detect {

struct Still {
  std::filesystem::path file;
  Geometry size;
  bool labelled = false;      // a label file of the same name stands beside it: NAME.txt
  std::vector<Truth> labels;  // in pixels of the still
};

// kBadInput when the picture or its labels cannot be read. Thread: setup.
Result<Still> read_still(const std::filesystem::path& file, const std::vector<JudgedClass>& classes);

// One look at a still, at one instant of a motion.
struct View {
  std::size_t still = 0;
  std::size_t motion = 0;
  double start_s = 0.0;    // in the trajectory's file
  sim::Position looks_at;  // the still's pixel that the picture's (0, 0) shows at the judged instant
};

struct ViewPlan {
  Geometry picture{640, 480};
  int repeats = 2;  // looks at each still in each motion
  std::uint64_t seed = 1;
};

// Draws them: instants all over a trajectory's file, the middle of the picture up to kJitter from the still's.
// kBadInput when a trajectory cannot be read or is too short. Thread: setup.
inline constexpr Geometry kJitter{48, 24};
Result<std::vector<View>> plan_views(const std::vector<Still>& stills,
                                     const std::vector<std::filesystem::path>& trajectories, const ViewPlan& plan);

// The frames that a camera sends until a look, and the frame after it, with one target: tau 11 ms, 200 frames/s, 10 mK
// a step. kBadInput when the still cannot be read. Thread: any.
Result<fidelity::CleanSequence> simulate(const Still& still, const std::filesystem::path& trajectory, const View& view,
                                         Geometry picture);

// --- The columns of the table: what the detectors are shown of each look.

enum class ColumnKind : std::uint8_t { kSharp, kBlurred, kLive, kBolo, kBaseline, kLearned };

struct Column {
  ColumnKind kind = ColumnKind::kSharp;
  std::string name;   // in JSON
  std::string title;  // in tables
  std::string words;  // in the help and on the page
};

// In the order in which shown_columns() makes them; learned ones follow.
inline constexpr std::size_t kSharpColumn = 0;
inline constexpr std::size_t kBlurredColumn = 1;
const std::vector<Column>& own_columns();

// What a column shows of one look.
struct Shown {
  Levels levels;
  std::string setting;  // what was picked with the truth, or measured
};

// own_columns() of the sequence's only target. Black and white are those of the still. kBadInput or kFailed from the
// solvers. Thread: any, several at once.
Result<std::vector<Shown>> shown_columns(const fidelity::Sequence& sequence);

}  // namespace bolo::tools::detect
