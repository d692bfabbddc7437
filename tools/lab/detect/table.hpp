// `bolo-lab eval detect`: every detector on every column of every observation. The detectors are given stills, each
// seen several times by a camera in somebody's hands.
#pragma once

#include "tools/lab/detect/detector.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::detect {

struct Still {
  std::filesystem::path file;
  Geometry size;
  bool labelled = false;      // a label file of the same name stands beside it: NAME.txt
  std::vector<Truth> labels;  // in pixels of the still
};

// kBadInput when the picture or its labels cannot be read. Thread: setup.
Result<Still> read_still(const std::filesystem::path& file, const std::vector<JudgedClass>& classes);

// One view of a still, at one instant of a motion.
struct View {
  std::size_t still = 0;
  std::size_t motion = 0;
  double start_s = 0.0;  // in the trajectory's file
  sim::Position origin;  // the still's pixel that the picture's (0, 0) shows at the judged instant
};

struct ViewPlan {
  Geometry picture{640, 480};
  int repeats = 2;  // views of each still in each motion
  std::uint64_t seed = 1;
};

// Draws them: instants all over a trajectory's file, the middle of the picture up to kJitter from the still's.
// kBadInput when a trajectory cannot be read or is too short. Thread: setup.
inline constexpr Geometry kJitter{48, 24};
Result<std::vector<View>> plan_views(const std::vector<Still>& stills,
                                     const std::vector<std::filesystem::path>& trajectories, const ViewPlan& plan);

// A camera's frames up to a view's instant, and the next one, with one target: tau 11 ms, 200 frames/s, 10 mK a step.
// kBadInput when the still cannot be read. Thread: any.
Result<fidelity::CleanSequence> simulate(const Still& still, const std::filesystem::path& trajectory, const View& view,
                                         Geometry picture);

// --- The columns of the table: the pictures of each observation that the detectors are given.

struct Column {
  std::string name;   // in JSON
  std::string words;  // what it is
};

// In the order in which shown_columns() makes them.
inline constexpr std::size_t kSharpColumn = 0;
inline constexpr std::size_t kBlurredColumn = 1;
const std::vector<Column>& columns();

// The sequence's only target as in columns(). Black and white are those of the still. kBadInput or kFailed from the
// solvers. Thread: any, several at once.
Result<std::vector<Levels>> shown_columns(const fidelity::Sequence& sequence);

// --- Detections.

// Options of `bolo-lab eval detect`.
struct Options {
  std::vector<std::filesystem::path> scenes;
  std::vector<std::filesystem::path> trajectories;
  std::vector<DetectorDescription> detectors;  // with their files' places
  // As the label files number them and the detectors name them.
  std::vector<JudgedClass> classes{{"person", 1}, {"bicycle", 2}, {"car", 3}};
  Geometry picture{640, 480};
  int repeats = 2;
  double noise_k = 0.03;
  int resamples = 1000;
  std::uint64_t seed = 1;
  int threads = 2;
};

// Detections in one view.
struct Observation {
  View view;
  double speed_px_s = 0.0;                                 // of the picture over the pixels, at the judged instant
  std::vector<Truth> labels;                               // people's boxes in this view; empty when the still has none
  std::vector<std::vector<std::vector<Detection>>> found;  // [detector][column]
};

struct Found {
  std::vector<Still> stills;
  std::vector<std::vector<bool>> knows;  // [detector][class]
  std::vector<Observation> observations;
};

// Opens stills and networks, simulates, restores, detects. kBadInput names what cannot be opened or run, kFailed an
// interrupt. Thread: setup.
Result<Found> run(const Options& options);

// --- The benefit of deblurring: AP of every column, against the blurred one, with intervals.

// As the verb prints it with --json: the schema is in its --help. Rows that people labelled come first; motions from
// slow to fast, detectors as given, then their mean. Thread: any.
Json table_of(const Found& found, const Options& options);

}  // namespace bolo::tools::detect
