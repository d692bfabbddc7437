// Boxes in a picture, and what is said of them.
#pragma once

#include <cstdint>

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

}  // namespace bolo::tools::detect
