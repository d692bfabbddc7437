// Average precision of boxes, as COCO defines it (Lin et al., "Microsoft COCO: Common Objects in Context", ECCV 2014,
// and cocodataset.org, "Detection Evaluation"), step by step as pycocotools' COCOeval does it:
//  1. in each image and class, detections in falling order of score, at most `most_detections`, each take the best
//     unmatched truth with an IoU of at least the threshold; objects come before what is ignored;
//  2. detections that took something ignored, and unmatched ones outside the range of areas, do not count;
//  3. over all images, precision at each recall is the best at that recall or a higher one, read at `recall_points`
//     equally spaced recalls;
//  4. AP is the mean over recalls and IoU thresholds; the total is the mean over the classes that have objects.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "tools/lab/detect/boxes.hpp"

namespace bolo::tools::detect {

struct ApSettings {
  std::vector<double> ious{0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95};  // at most 32
  int recall_points = 101;                                                          // from 0 to 1
  std::size_t most_detections = 100;                                                // an image and class
  double least_area_px2 = 0.0;                                                      // objects outside are ignored
  double most_area_px2 = std::numeric_limits<double>::infinity();
};

// What is true of one image, and what was detected there.
struct ImageBoxes {
  std::vector<Truth> truth;
  std::vector<Detection> detections;
};

inline constexpr double kNoScore = std::numeric_limits<double>::quiet_NaN();

// Each 0 to 1, and kNoScore where nothing was to be found.
struct ClassScore {
  double ap = kNoScore;    // mean over the IoU thresholds
  double ap50 = kNoScore;  // at the threshold 0.5 and 0.75; kNoScore where the settings have none
  double ap75 = kNoScore;
  double objects = 0.0;
};
struct ApScore {
  ClassScore total;  // means over the classes with objects, sum of the objects
  std::vector<ClassScore> classes;
};

// Matches once, and scores any weighting of the images: a weight of 2 counts an image twice, as when it is drawn twice.
class Evaluator {
 public:
  // Thread: any. `labels`: the classes are 0 .. labels - 1; others are left out.
  Evaluator(std::span<const ImageBoxes> images, int labels, ApSettings settings = {});

  // `weights`: one an image, none negative; empty: all 1. Thread: any, several at once.
  ApScore score(std::span<const int> weights = {}) const;

 private:
  struct Ranked {  // a detection; bit i is for settings.ious[i]
    double score = 0.0;
    std::size_t image = 0;
    std::uint32_t right = 0;
    std::uint32_t ignored = 0;
  };
  struct Class {
    std::vector<Ranked> ranking;       // of all images, falling scores
    std::vector<int> objects_a_image;  //
  };

  void match(const ImageBoxes& image, std::size_t index, int label);
  ClassScore score_of(const Class& one, std::span<const int> weights) const;

  ApSettings settings_;
  std::vector<Class> classes_;
};

// --- How far a figure would scatter if other scenes had been taken: the percentile bootstrap (Efron, "Bootstrap
// methods: another look at the jackknife", 1979). Scenes are drawn anew, with replacement, each with all its images.

// How often each of `scenes` scenes is drawn in the draw number `draw`; they sum to `scenes`. Thread: any.
std::vector<int> drawn_scenes(std::size_t scenes, std::uint64_t seed, std::uint64_t draw);

struct Interval {
  double low = 0.0;
  double high = 0.0;
};

// The middle 95 % of the values that are numbers; NaN twice where there are none. Thread: any.
Interval interval_95(std::vector<double> values);

}  // namespace bolo::tools::detect
