#include "tools/lab/detect/view_truth.hpp"

#include <array>

namespace bolo::tools::detect {

std::vector<Truth> truth_in_view(const std::vector<Truth>& labels, int classes, Geometry still, Geometry view,
                                 sim::Position at) {
  std::vector<Truth> seen;
  for (Truth truth : labels) {
    const Box whole = moved(truth.box, -at.x_px, -at.y_px);
    truth.box = clipped(whole, view.width, view.height);
    if (area(truth.box) <= 0.0) continue;
    if (truth.kind == TruthKind::kObject && area(truth.box) < kLeastVisible * area(whole)) {
      truth.kind = TruthKind::kIgnored;
    }
    seen.push_back(truth);
  }
  // The still's place in the view, and the four bands around it.
  const Box inside = clipped({-at.x_px, -at.y_px, static_cast<double>(still.width), static_cast<double>(still.height)},
                             view.width, view.height);
  const double width = view.width;
  const double height = view.height;
  const double right = inside.x + inside.width;
  const double bottom = inside.y + inside.height;
  const std::array<Box, 4> bands{Box{0.0, 0.0, inside.x, height}, Box{right, 0.0, width - right, height},
                                 Box{0.0, 0.0, width, inside.y}, Box{0.0, bottom, width, height - bottom}};
  for (const Box& band : bands) {
    if (area(band) <= 0.0) continue;
    for (int label = 0; label < classes; ++label) seen.push_back({label, band, TruthKind::kCrowd});
  }
  return seen;
}

}  // namespace bolo::tools::detect
