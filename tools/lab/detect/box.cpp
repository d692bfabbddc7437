#include "tools/lab/detect/box.hpp"

#include <algorithm>

namespace bolo::tools::detect {

double area(const Box& box) { return box.width * box.height; }

double intersection(const Box& a, const Box& b) {
  const double width = std::min(a.x + a.width, b.x + b.width) - std::max(a.x, b.x);
  const double height = std::min(a.y + a.height, b.y + b.height) - std::max(a.y, b.y);
  return width > 0.0 && height > 0.0 ? width * height : 0.0;
}

double iou(const Box& a, const Box& b) {
  const double common = intersection(a, b);
  return common > 0.0 ? common / (area(a) + area(b) - common) : 0.0;
}

double share_within(const Box& box, const Box& other) {
  const double common = intersection(box, other);
  return common > 0.0 ? common / area(box) : 0.0;
}

Box clipped(const Box& box, double width, double height) {
  const double left = std::clamp(box.x, 0.0, width);
  const double top = std::clamp(box.y, 0.0, height);
  const double right = std::clamp(box.x + box.width, left, width);
  const double bottom = std::clamp(box.y + box.height, top, height);
  return {left, top, right - left, bottom - top};
}

Box moved(const Box& box, double dx, double dy) { return {box.x + dx, box.y + dy, box.width, box.height}; }

}  // namespace bolo::tools::detect
