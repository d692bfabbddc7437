// Boxes in a picture, what is said of them, and the label files that people draw them in.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "src/sim/path.hpp"

namespace bolo::tools::detect {

// Pixels, from the left upper corner; pixel (0, 0) covers [0, 1) x [0, 1).
struct Box {
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;

  constexpr bool operator==(const Box&) const = default;
};

// What a detector says. `label`: an index of the classes that are judged.
struct Detection {
  int label = 0;
  double score = 0.0;
  Box box;
};

enum class TruthKind : std::uint8_t {
  kObject,   // to be found
  kIgnored,  // neither to be found nor wrong when found, once
  kCrowd,    // the same for any number of detections that lie mostly within it: for areas without labels
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
Box clipped(const Box& box, double width, double height);  // to the picture; empty outside
Box moved(const Box& box, double dx, double dy);           //

// --- The classes that are judged, and label files: one line a box, `class cx cy w h`, shares of the picture (YOLO's
// form).

struct JudgedClass {
  std::string name;  // as the detectors' lists of classes have it
  int number = 0;    // what label files write for it
};

// "1:person,3:car". kBadInput says what is wrong. Thread: any.
Result<std::vector<JudgedClass>> classes_of(const std::string& text);

// The boxes of the judged classes, in pixels of a picture of this size; others are left out. kBadInput names file and
// line. Thread: any.
Result<std::vector<Truth>> read_labels(const std::filesystem::path& file, Geometry picture,
                                       const std::vector<JudgedClass>& classes);

// A file with one name a line, as Darknet's `coco.names`; kBadInput when it cannot be read or has none. Thread: any.
Result<std::vector<std::string>> read_names(const std::filesystem::path& file);

// Names between commas, blanks around them taken off. Thread: any.
std::vector<std::string> split_names(const std::string& text);

// --- Boxes that people drew over a still, as a moving camera sees them at one instant.

// An object of which less is to be seen at the border of the view is ignored.
inline constexpr double kLeastVisible = 0.5;

// The labels of a still of size `still`, seen by a view of size `view` whose pixel (0, 0) looks at the still's pixel
// `at`: moved, cut to the view, those outside left out. What the view shows beyond the still is a mirrored part of it
// that nobody labelled: a crowd of every class, 0 .. classes - 1. Thread: any.
std::vector<Truth> truth_in_view(const std::vector<Truth>& labels, int classes, Geometry still, Geometry view,
                                 sim::Position at);

}  // namespace bolo::tools::detect
