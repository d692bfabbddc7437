// Average precision of its input, for average_precision_test.py. Input:
//   labels images, then for each image: truths detections,
//   truths as `label kind x y w h`, detections as `label score x y w h`.
#include <cstdio>
#include <iostream>

#include "tools/lab/detect/boxes.hpp"

int main() {
  using namespace bolo::tools::detect;
  int labels = 0;
  std::size_t images = 0;
  std::cin >> labels >> images;
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
  std::printf("%.17g\n", Evaluator(boxes, labels).score().ap);
}
