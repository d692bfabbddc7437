// Boxes in a picture, detections, label files, and average precision.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/sim/path.hpp"

namespace bolo::tools::detect {

// In pixels, from the upper left corner; pixel (0, 0) covers [0, 1) x [0, 1).
struct Box {
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;

  constexpr bool operator==(const Box&) const = default;
};

// A detector's result. `label`: index into the judged classes.
struct Detection {
  int label = 0;
  double score = 0.0;
  Box box;
};

enum class TruthKind : std::uint8_t {
  kObject,   // must be found
  kIgnored,  // need not be found; the first match is not counted as wrong
  kCrowd,    // like kIgnored for any number of detections that lie mostly within: for areas without labels
};

struct Truth {
  int label = 0;
  Box box;
  TruthKind kind = TruthKind::kObject;
};

// Thread of all: any.
double area(const Box& box);
double intersection(const Box& a, const Box& b);
double iou(const Box& a, const Box& b);                    // intersection over union; 0 for empty boxes
double share_within(const Box& box, const Box& other);     // share of the box's area; 0 for an empty box
Box clipped(const Box& box, double width, double height);  // to the picture; empty outside
Box moved(const Box& box, double dx, double dy);           //

// --- Judged classes, and label files: one line a box, `class cx cy w h` in shares of the picture (YOLO format).

struct JudgedClass {
  std::string name;  // as in the detectors' class lists
  int number = 0;    // as in label files
};

// Boxes of the judged classes, in pixels of a picture of this size; other classes are skipped. kBadInput names file and
// line. Thread: any.
Result<std::vector<Truth>> read_labels(const std::filesystem::path& file, Geometry picture,
                                       const std::vector<JudgedClass>& classes);

// Reads a file with one name a line, like Darknet's `coco.names`; kBadInput if unreadable or empty. Thread: any.
Result<std::vector<std::string>> read_names(const std::filesystem::path& file);

// Splits at commas and trims blanks. Thread: any.
std::vector<std::string> split_names(const std::string& text);

// --- Boxes labelled on a still, as a moving camera sees them at one instant.

// An object with a smaller visible share is ignored.
inline constexpr double kLeastVisible = 0.5;

// The labels of a still of size `still`, in a view of size `view` whose pixel (0, 0) is at the still's pixel `at`:
// moved, clipped to the view, those outside left out. Beyond the still the view shows a mirrored, unlabelled part of
// it: a crowd of every class 0 .. classes - 1. Thread: any.
std::vector<Truth> truth_in_view(const std::vector<Truth>& labels, int classes, Geometry still, Geometry view,
                                 sim::Position at);

// --- Average precision of boxes, as COCO defines it (Lin et al., "Microsoft COCO: Common Objects in Context", ECCV
// 2014, and cocodataset.org, "Detection Evaluation"), step by step as pycocotools' COCOeval does it:
//  1. in each image and class, detections in falling order of score, at most 100, each take the best unmatched truth
//     with an IoU of at least the threshold; objects come before what is ignored;
//  2. detections that took something ignored do not count;
//  3. over all images, precision at each recall is the best at that recall or a higher one, read at 101 equally
//     spaced recalls;
//  4. AP is the mean over recalls and the IoU thresholds 0.5, 0.55 ... 0.95, and over the classes that have objects.

struct ImageBoxes {
  std::vector<Truth> truth;
  std::vector<Detection> detections;
};

inline constexpr double kNoScore = std::numeric_limits<double>::quiet_NaN();

struct ApScore {
  double ap = kNoScore;  // 0 to 1; kNoScore if nothing was to be found
  double objects = 0.0;
};

// Matches once, then scores any weighting of images: a weight of 2 counts an image twice, as in the bootstrap.
class Evaluator {
 public:
  // Thread: any. `labels`: classes are 0 .. labels - 1; others are ignored.
  Evaluator(std::span<const ImageBoxes> images, int labels);

  // `weights`: one per image, none negative; empty: all 1. Thread: any, several at once.
  ApScore score(std::span<const int> weights = {}) const;

 private:
  struct Ranked {  // a detection; bit i is for the i-th threshold
    double score = 0.0;
    std::size_t image = 0;
    std::uint32_t right = 0;
    std::uint32_t ignored = 0;
  };
  struct Class {
    std::vector<Ranked> ranking;       // of all images, by falling score
    std::vector<int> objects_a_image;  //
  };

  void match(const ImageBoxes& image, std::size_t index, int label);
  ApScore score_of(const Class& one, std::span<const int> weights) const;

  std::vector<Class> classes_;
};

// --- Uncertainty of a figure over other choices of scenes: percentile bootstrap (Efron, "Bootstrap methods: another
// look at the jackknife", 1979). Scenes are drawn with replacement, each with all its images.

// How often each of `scenes` scenes is drawn in draw `draw`; the counts sum to `scenes`. Thread: any.
std::vector<int> drawn_scenes(std::size_t scenes, std::uint64_t seed, std::uint64_t draw);

struct Interval {
  double low = 0.0;
  double high = 0.0;
};

// Middle 95 % of the finite values; NaN twice if there are none. Thread: any.
Interval interval_95(std::vector<double> values);

}  // namespace bolo::tools::detect
