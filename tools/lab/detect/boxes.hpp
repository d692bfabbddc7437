// Boxes in a picture, detections, label files drawn by people, and average precision.
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

// In pixels from the top left corner; pixel (0, 0) covers [0, 1) x [0, 1).
struct Box {
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;

  constexpr bool operator==(const Box&) const = default;
};

// A detector's result. `label`: index of a judged class.
struct Detection {
  int label = 0;
  double score = 0.0;
  Box box;
};

enum class TruthKind : std::uint8_t {
  kObject,   // should be found
  kIgnored,  // need not be found; one detection of it is not an error
  kCrowd,    // the same for any number of detections mostly within it: for unlabelled areas
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
double share_within(const Box& box, const Box& other);     // of the box's area; 0 for an empty box
Box clipped(const Box& box, double width, double height);  // to the picture; empty if outside
Box moved(const Box& box, double dx, double dy);           //

// --- Judged classes, and label files in YOLO's format: a line per box, `class cx cy w h` in shares of the picture.

struct JudgedClass {
  std::string name;  // as in the detectors' class lists
  int number = 0;    // in label files
};

// The boxes of judged classes, in pixels of a picture of this size. kBadInput names file and line. Thread: any.
Result<std::vector<Truth>> read_labels(const std::filesystem::path& file, Geometry picture,
                                       const std::vector<JudgedClass>& classes);

// A file with one name per line, like Darknet's `coco.names`; kBadInput when it is unreadable or empty. Thread: any.
Result<std::vector<std::string>> read_names(const std::filesystem::path& file);

// Names separated by commas, trimmed. Thread: any.
std::vector<std::string> split_names(const std::string& text);

// --- Labels of a still, as a moving camera sees them at one instant.

// Least share of an object in the view; with less it is ignored.
inline constexpr double kLeastVisible = 0.5;

// The labels of a still of size `still` in a view of size `view` whose pixel (0, 0) is at the still's pixel `at`: moved
// and clipped to the view; outside ones are dropped. Beyond the still the view shows a mirrored, unlabelled part of it,
// which becomes a crowd of every class 0 .. classes - 1. Thread: any.
std::vector<Truth> truth_in_view(const std::vector<Truth>& labels, int classes, Geometry still, Geometry view,
                                 sim::Position at);

// --- Average precision of boxes as COCO defines it (Lin et al., "Microsoft COCO: Common Objects in Context", ECCV
// 2014, and cocodataset.org, "Detection Evaluation"), with the steps of pycocotools' COCOeval:
// 1. In each image and class, at most 100 detections in falling order of score each take the best unmatched truth
//    with an IoU of at least the threshold; objects take precedence over ignored truth.
// 2. Detections that took ignored truth do not count.
// 3. Over all images, precision at each recall is the best at that recall or a higher one, read at 101 equally
//    spaced recalls.
// 4. AP is the mean over recalls, IoU thresholds 0.5, 0.55 ... 0.95, and classes that have objects.

struct ImageBoxes {
  std::vector<Truth> truth;
  std::vector<Detection> detections;
};

inline constexpr double kNoScore = std::numeric_limits<double>::quiet_NaN();

struct ApScore {
  double ap = kNoScore;  // 0 to 1; kNoScore if there was nothing to find
  double objects = 0.0;
};

// Matches once, then scores any weighting of the images: weight 2 counts an image twice, as the bootstrap may.
class Evaluator {
 public:
  // Thread: any. `labels`: number of classes; detections of others are skipped.
  Evaluator(std::span<const ImageBoxes> images, int labels);

  // `weights`: one per image, non-negative; empty: all 1. Thread: any, several at once.
  ApScore score(std::span<const int> weights = {}) const;

 private:
  struct Ranked {  // a detection; bit i belongs to the i-th threshold
    double score = 0.0;
    std::size_t image = 0;
    std::uint32_t right = 0;
    std::uint32_t ignored = 0;
  };
  struct Class {
    std::vector<Ranked> ranking;       // over all images, by falling score
    std::vector<int> objects_a_image;  //
  };

  void match(const ImageBoxes& image, std::size_t index, int label);
  ApScore score_of(const Class& one, std::span<const int> weights) const;

  std::vector<Class> classes_;
};

// --- Scatter of a figure over other choices of scenes: percentile bootstrap (Efron, "Bootstrap methods: another look
// at the jackknife", 1979). Scenes are drawn with replacement, each with all its images.

// How often each of `scenes` scenes occurs in draw `draw`; sums to `scenes`. Thread: any.
std::vector<int> drawn_scenes(std::size_t scenes, std::uint64_t seed, std::uint64_t draw);

struct Interval {
  double low = 0.0;
  double high = 0.0;
};

// The central 95 % of the values, ignoring NaN; NaN twice if there are none. Thread: any.
Interval interval_95(std::vector<double> values);

}  // namespace bolo::tools::detect
