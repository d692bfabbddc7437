// Average precision on examples that were worked by hand, and by others.
#include "tools/lab/detect/boxes.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace bolo::tools::detect::average_precision_test {
namespace {

Detection detected(double score, Box box, int label = 0) { return {label, score, box}; }
Truth object(Box box, TruthKind kind = TruthKind::kObject, int label = 0) { return {label, box, kind}; }

ApSettings at_iou(double iou) {
  ApSettings settings;
  settings.ious = {iou};
  return settings;
}

// A box 10 x 10 that `share` of its width is moved: IoU (1 - share) / (1 + share).
Box square(double x = 0.0, double y = 0.0) { return {x, y, 10.0, 10.0}; }

// The worked example of R. Padilla, S. L. Netto and E. A. B. da Silva, "A Survey on Performance Metrics for
// Object-Detection Algorithms", IWSSIP 2020 (github.com/rafaelpadilla/Object-Detection-Metrics, sample 2): 15 objects
// and 24 detections in seven pictures, IoU 0.3; its published AP is 26.84 % read at 11 recalls.
// Boxes there include their last pixel: 1 is added to each side.
std::vector<ImageBoxes> padilla() {
  std::vector<ImageBoxes> images{
      {{object({25, 16, 38, 56}), object({129, 123, 41, 62})},
       {detected(.88, {5, 67, 31, 48}), detected(.70, {119, 111, 40, 67}), detected(.80, {124, 9, 49, 67})}},
      {{object({123, 11, 43, 55}), object({38, 132, 59, 45})},
       {detected(.71, {64, 111, 64, 58}), detected(.54, {26, 140, 60, 47}), detected(.74, {19, 18, 43, 35})}},
      {{object({16, 14, 35, 48}), object({123, 30, 49, 44}), object({99, 139, 47, 47})},
       {detected(.18, {109, 15, 77, 39}), detected(.67, {86, 63, 46, 45}), detected(.38, {160, 62, 36, 53}),
        detected(.91, {105, 131, 47, 47}), detected(.44, {18, 148, 40, 44})}},
      {{object({53, 42, 40, 52}), object({154, 43, 31, 34})},
       {detected(.35, {83, 28, 28, 26}), detected(.78, {28, 68, 42, 67}), detected(.45, {87, 89, 25, 39}),
        detected(.14, {10, 155, 60, 26})}},
      {{object({59, 31, 44, 51}), object({48, 128, 34, 52})},
       {detected(.62, {50, 38, 28, 46}), detected(.44, {95, 11, 53, 28}), detected(.95, {29, 131, 72, 29}),
        detected(.23, {29, 163, 72, 29})}},
      {{object({36, 89, 52, 76}), object({62, 58, 44, 67})},
       {detected(.45, {43, 48, 74, 38}), detected(.84, {17, 155, 29, 35}), detected(.43, {95, 110, 25, 42})}},
      {{object({28, 31, 55, 63}), object({58, 67, 50, 58})},
       {detected(.48, {16, 20, 101, 88}), detected(.95, {33, 116, 37, 49})}}};
  const auto grow = [](Box& box) {
    box.width += 1.0;
    box.height += 1.0;
  };
  for (ImageBoxes& image : images) {
    for (Truth& truth : image.truth) grow(truth.box);
    for (Detection& detection : image.detections) grow(detection.box);
  }
  return images;
}

TEST(AveragePrecision, IsAsPublishedForPadillasExample) {
  ApSettings settings = at_iou(0.3);
  settings.recall_points = 11;
  const ApScore score = Evaluator(padilla(), 1, settings).score();
  EXPECT_EQ(score.total.objects, 15.0);
  EXPECT_NEAR(100.0 * score.total.ap, 26.84, 0.005);
}

// In the published ranking of the 24 detections the 1st, 3rd, 10th, 12th, 13th, 14th and 23rd are right.
TEST(AveragePrecision, ReadsPadillasCurveAt101Recalls) {
  const ApScore score = Evaluator(padilla(), 1, at_iou(0.3)).score();
  const std::array<int, 7> ranks{1, 3, 10, 12, 13, 14, 23};
  std::array<double, 7> precision{};
  double best = 0.0;
  for (std::size_t k = ranks.size(); k-- > 0;) {
    best = std::max(best, static_cast<double>(k + 1) / ranks[k]);
    precision[k] = best;
  }
  double sum = 0.0;
  for (int r = 0; r <= 100; ++r) {
    const int needed = r == 0 ? 1 : static_cast<int>(std::ceil(r * 15 / 100.0 - 1e-12));
    if (needed <= 7) sum += precision[static_cast<std::size_t>(needed - 1)];
  }
  EXPECT_NEAR(score.total.ap, sum / 101.0, 1e-12);
}

TEST(AveragePrecision, OfAPerfectDetectorIsOneAndOfABlindOneZero) {
  const std::vector<ImageBoxes> perfect{{{object(square())}, {detected(0.9, square())}}};
  EXPECT_DOUBLE_EQ(Evaluator(perfect, 1).score().total.ap, 1.0);
  EXPECT_DOUBLE_EQ(Evaluator(perfect, 1).score().total.ap50, 1.0);
  const std::vector<ImageBoxes> blind{{{object(square())}, {}}};
  EXPECT_DOUBLE_EQ(Evaluator(blind, 1).score().total.ap, 0.0);
}

TEST(AveragePrecision, CountsTheThresholdsThatABoxReaches) {
  // Moved by a tenth: IoU 9/11 = 0.818, which 0.5 to 0.8 are reached by: 7 of 10.
  const std::vector<ImageBoxes> images{{{object(square())}, {detected(0.9, square(1.0))}}};
  const ApScore score = Evaluator(images, 1).score();
  EXPECT_NEAR(score.total.ap, 0.7, 1e-12);
  EXPECT_DOUBLE_EQ(score.total.ap75, 1.0);
}

TEST(AveragePrecision, GivesAnObjectToOneDetectionOnly) {
  // Two objects, three detections: right, a second one of the same object (wrong), right: precision 1 up to recall 0.5,
  // then 2/3. 51 and 50 of 101 recalls.
  const std::vector<ImageBoxes> images{
      {{object(square()), object(square(50))},
       {detected(0.9, square()), detected(0.8, square(0.5)), detected(0.7, square(50))}}};
  EXPECT_NEAR(Evaluator(images, 1, at_iou(0.5)).score().total.ap, (51.0 + 50.0 * 2.0 / 3.0) / 101.0, 1e-12);
}

TEST(AveragePrecision, TakesTheBestOverlapInOrderOfScore) {
  // The surer detection lies nearer to the second object, and takes it; the other one has the first left.
  const std::vector<ImageBoxes> images{
      {{object(square(0)), object(square(4))}, {detected(0.6, square(1)), detected(0.9, square(3))}}};
  EXPECT_DOUBLE_EQ(Evaluator(images, 1, at_iou(0.5)).score().total.ap, 1.0);
}

TEST(AveragePrecision, LeavesOutWhatIsIgnored) {
  const std::vector<ImageBoxes> images{{{object(square()), object(square(50), TruthKind::kIgnored)},
                                        {detected(0.95, square(50)), detected(0.9, square())}}};
  const ApScore score = Evaluator(images, 1).score();
  EXPECT_EQ(score.total.objects, 1.0);
  EXPECT_DOUBLE_EQ(score.total.ap, 1.0);
  // A second detection of it is wrong, as it was taken: it ranks before the right one.
  auto twice = images;
  twice[0].detections.push_back(detected(0.94, square(50)));
  EXPECT_DOUBLE_EQ(Evaluator(twice, 1).score().total.ap, 0.5);
}

TEST(AveragePrecision, ACrowdTakesAnyNumberThatLieWithin) {
  std::vector<ImageBoxes> images{
      {{object(square()), object({100, 0, 100, 100}, TruthKind::kCrowd)}, {detected(0.9, square())}}};
  for (int i = 0; i < 5; ++i) images[0].detections.push_back(detected(0.95, square(110.0 + 10.0 * i, 20)));
  EXPECT_DOUBLE_EQ(Evaluator(images, 1).score().total.ap, 1.0);
  // Half outside: wrong from IoU 0.55 on.
  images[0].detections = {detected(0.9, square()), detected(0.95, square(95))};
  EXPECT_NEAR(Evaluator(images, 1).score().total.ap, (1.0 + 9 * 0.5) / 10.0, 1e-12);
}

TEST(AveragePrecision, AnObjectIsBetterThanAnythingIgnored) {
  // The detection covers the ignored box exactly and the object well enough: it takes the object.
  const std::vector<ImageBoxes> images{
      {{object(square(), TruthKind::kIgnored), object(square(1))}, {detected(0.9, square())}}};
  EXPECT_DOUBLE_EQ(Evaluator(images, 1, at_iou(0.5)).score().total.ap, 1.0);
}

TEST(AveragePrecision, IgnoresObjectsAndStrayDetectionsOutsideTheRangeOfAreas) {
  ApSettings settings = at_iou(0.5);
  settings.least_area_px2 = 64.0;
  const Box small{50, 50, 5, 5};
  const Box stray{80, 80, 5, 5};
  const std::vector<ImageBoxes> images{
      {{object(square()), object(small)}, {detected(0.99, stray), detected(0.95, small), detected(0.9, square())}}};
  const ApScore score = Evaluator(images, 1, settings).score();
  EXPECT_EQ(score.total.objects, 1.0);
  EXPECT_DOUBLE_EQ(score.total.ap, 1.0);
}

TEST(AveragePrecision, KeepsTheBestOfTooManyDetections) {
  ApSettings settings = at_iou(0.5);
  settings.most_detections = 2;
  const std::vector<ImageBoxes> images{
      {{object(square())}, {detected(0.1, square()), detected(0.5, square(50)), detected(0.6, square(70))}}};
  EXPECT_DOUBLE_EQ(Evaluator(images, 1, settings).score().total.ap, 0.0);
  settings.most_detections = 3;
  EXPECT_NEAR(Evaluator(images, 1, settings).score().total.ap, 1.0 / 3.0, 1e-12);
}

TEST(AveragePrecision, MeansTheClassesThatHaveObjects) {
  const std::vector<ImageBoxes> images{
      {{object(square(), TruthKind::kObject, 0), object(square(50), TruthKind::kObject, 2)},
       {detected(0.9, square(), 0), detected(0.9, square(), 1), detected(0.9, square(), 2),
        detected(0.9, square(), 7)}}};
  const ApScore score = Evaluator(images, 3).score();
  EXPECT_DOUBLE_EQ(score.classes[0].ap, 1.0);
  EXPECT_TRUE(std::isnan(score.classes[1].ap));
  EXPECT_DOUBLE_EQ(score.classes[2].ap, 0.0);
  EXPECT_DOUBLE_EQ(score.total.ap, 0.5);
  EXPECT_EQ(score.total.objects, 2.0);
}

TEST(AveragePrecision, OfNothingToFindIsNoNumber) {
  const std::vector<ImageBoxes> images{{{}, {detected(0.9, square())}}};
  EXPECT_TRUE(std::isnan(Evaluator(images, 1).score().total.ap));
  EXPECT_TRUE(std::isnan(Evaluator({}, 1).score().total.ap));
}

// What the bootstrap relies on.
TEST(AveragePrecision, AWeightIsARepetition) {
  const std::vector<ImageBoxes> images = padilla();
  const std::vector<int> weights{2, 0, 1, 3, 1, 0, 1};
  std::vector<ImageBoxes> repeated;
  for (std::size_t i = 0; i < images.size(); ++i) {
    for (int n = 0; n < weights[i]; ++n) repeated.push_back(images[i]);
  }
  const ApScore weighted = Evaluator(images, 1, at_iou(0.3)).score(weights);
  const ApScore drawn = Evaluator(repeated, 1, at_iou(0.3)).score();
  EXPECT_NEAR(weighted.total.ap, drawn.total.ap, 1e-12);
  EXPECT_EQ(weighted.total.objects, drawn.total.objects);
}

}  // namespace
}  // namespace bolo::tools::detect::average_precision_test
