// `bolo-lab eval detect`: every detector on every column of every observation. The detectors see stills, each viewed
// several times by a hand-held camera.
#pragma once

#include "tools/lab/detect/detector.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::detect {

struct Still {
  std::filesystem::path file;
  Geometry size;
  bool labelled = false;      // the label file NAME.txt exists beside it
  std::vector<Truth> labels;  // in pixels of the still
};

// kBadInput if the picture or its labels cannot be read. Thread: setup.
Result<Still> read_still(const std::filesystem::path& file, const std::vector<JudgedClass>& classes);

// One view of a still, at one instant of a motion.
struct View {
  std::size_t still = 0;
  std::size_t motion = 0;
  double start_s = 0.0;  // in the trajectory's file
  sim::Position origin;  // the still's pixel at the picture's (0, 0) at the judged instant
};

struct ViewPlan {
  Geometry picture{640, 480};
  int repeats = 2;  // views of each still in each motion
  std::uint64_t seed = 1;
};

// Draws the views: instants spread over a trajectory's file, picture centres up to kJitter from the still's centre.
// kBadInput if a trajectory cannot be read or is too short. Thread: setup.
inline constexpr Geometry kJitter{48, 24};
Result<std::vector<View>> plan_views(const std::vector<Still>& stills,
                                     const std::vector<std::filesystem::path>& trajectories, const ViewPlan& plan);

// A camera's frames up to a view's instant, and the next one, with one target: tau 11 ms, 200 frames/s, 10 mK a step.
// kBadInput if the still cannot be read. Thread: any.
Result<fidelity::CleanSequence> simulate(const Still& still, const std::filesystem::path& trajectory, const View& view,
                                         Geometry picture);

// --- Columns of the table: the pictures of each observation that the detectors see.

struct Column {
  std::string name;   // in JSON
  std::string words;  // description
};

// In the order of shown_columns().
inline constexpr std::size_t kSharpColumn = 0;
inline constexpr std::size_t kBlurredColumn = 1;
const std::vector<Column>& columns();

// The sequence's only target, one picture per column. Black and white levels are the still's. kBadInput or kFailed from
// the solvers. Thread: any, several at once.
Result<std::vector<Levels>> shown_columns(const fidelity::Sequence& sequence);

struct Options {
  std::vector<std::filesystem::path> scenes;
  std::vector<std::filesystem::path> trajectories;
  std::vector<DetectorDescription> detectors;  // with resolved files
  // Numbers as in the label files, names as in the detectors.
  std::vector<JudgedClass> classes{{"person", 1}, {"bicycle", 2}, {"car", 3}};
  Geometry picture{640, 480};
  int repeats = 2;
  double noise_k = 0.03;
  int resamples = 1000;
  std::uint64_t seed = 1;
  int threads = 2;
};

struct Observation {
  View view;
  double speed_px_s = 0.0;                                 // of the picture over the pixels, at the judged instant
  std::vector<Truth> labels;                               // labels in this view; empty if the still has none
  std::vector<std::vector<std::vector<Detection>>> found;  // [detector][column]
};

struct Found {
  std::vector<Still> stills;
  std::vector<std::vector<bool>> knows;  // [detector][class]
  std::vector<Observation> observations;
};

// Opens stills and networks, simulates, deblurs, detects. kBadInput names what cannot be opened or run, kFailed an
// interrupt. Thread: setup.
Result<Found> run(const Options& options);

// --- The benefit of deblurring: AP of every column, against the blurred one, with intervals.

// The verb's --json output; the schema is in its --help. Labelled rows come first; motions from slow to fast, detectors
// as given, then their mean. Thread: any.
Json table_of(const Found& found, const Options& options);

}  // namespace bolo::tools::detect
