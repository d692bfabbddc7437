// Scores what it reads, for average_precision_test.py: numbers in, one line of numbers out.
//   labels images least_area most_area, then for each image: truths detections,
//   truths as `label kind x y w h`, detections as `label score x y w h`.
#include <cstdio>
#include <iostream>

#include "tools/lab/detect/boxes.hpp"

int main() {
  using namespace bolo::tools::detect;
  int labels = 0;
  std::size_t images = 0;
  ApSettings settings;
  std::cin >> labels >> images >> settings.least_area_px2 >> settings.most_area_px2;
  std::vector<ImageBoxes> boxes(images);
  for (ImageBoxes& image : boxes) {
    std::size_t truths = 0;
    std::size_t detections = 0;
    std::cin >> truths >> detections;
    image.truth.resize(truths);
    for (Truth& t : image.truth) {
      int kind = 0;
      std::cin >> t.label >> kind >> t.box.x >> t.box.y >> t.box.width >> t.box.height;
      t.kind = static_cast<TruthKind>(kind);
    }
    image.detections.resize(detections);
    for (Detection& d : image.detections) {
      std::cin >> d.label >> d.score >> d.box.x >> d.box.y >> d.box.width >> d.box.height;
    }
  }
  if (!std::cin) return 1;
  const ApScore score = Evaluator(boxes, labels, settings).score();
  std::printf("%.17g %.17g %.17g", score.total.ap, score.total.ap50, score.total.ap75);
  for (const ClassScore& one : score.classes) std::printf(" %.17g", one.ap);
  std::printf("\n");
}
