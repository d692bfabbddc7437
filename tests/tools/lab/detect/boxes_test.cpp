// Boxes, label files, labels as a moving camera sees them, the bootstrap, and average precision.
#include "tools/lab/detect/boxes.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::tools::detect::boxes_test {

TEST(Boxes, OverlapAsByHand) {
  EXPECT_DOUBLE_EQ(iou({0, 0, 10, 10}, {5, 0, 10, 10}), 50.0 / 150.0);
  EXPECT_DOUBLE_EQ(iou({0, 0, 10, 10}, {10, 0, 10, 10}), 0.0);
  EXPECT_DOUBLE_EQ(iou({0, 0, 0, 10}, {0, 0, 0, 10}), 0.0);
  EXPECT_DOUBLE_EQ(share_within({0, 0, 10, 10}, {5, 0, 100, 100}), 0.5);
  EXPECT_EQ(clipped({-5, 470, 20, 20}, 640, 480), (Box{0, 470, 15, 10}));
  EXPECT_DOUBLE_EQ(area(clipped({700, 0, 20, 20}, 640, 480)), 0.0);
}

class Labels : public ::testing::Test {
 protected:
  std::filesystem::path file(const std::string& text) const {
    std::ofstream(scratch_ / "labels.txt") << text;
    return scratch_ / "labels.txt";
  }
  const Scratch scratch_;
  const std::vector<JudgedClass> classes_{{"person", 1}, {"car", 3}};
};

TEST_F(Labels, AreSharesOfThePicture) {
  const auto text = file("3 0.5 0.25 0.1 0.5\n\n17 0.5 0.5 0.1 0.1\n1 0.05 0.9 0.1 0.2\r\n");
  const auto truth = must(read_labels(text, {640, 480}, classes_));
  ASSERT_EQ(truth->size(), 2U);
  EXPECT_EQ((*truth)[0].label, 1);
  EXPECT_NEAR(iou((*truth)[0].box, {288, 0, 64, 240}), 1.0, 1e-9);
  EXPECT_EQ((*truth)[1].label, 0);
}

TEST_F(Labels, RefuseWhatIsWrongWithFileAndLine) {
  for (const char* wrong : {"1 0.5 0.5 0.1\n", "1 0.5 0.5 0.1 0.1 0.1\n", "1 0.5 0.5 0.1 1.5\n", "1 0.5 nan 0.1 0.1\n",
                            "1 0.5 0.5 0 0.1\n", "-1 0.5 0.5 0.1 0.1\n", "person 0.5 0.5 0.1 0.1\n"}) {
    SCOPED_TRACE(wrong);
    const auto refused = read_labels(file("1 0.5 0.5 0.1 0.1\n" + std::string(wrong)), {640, 480}, classes_);
    expect_error(refused, {"labels.txt:2: expected"});
  }
  EXPECT_FALSE(read_labels(scratch_ / "none.txt", {640, 480}, classes_));
  EXPECT_FALSE(read_names(scratch_ / "none.txt"));
  EXPECT_FALSE(read_names(file("\n\n")));
  EXPECT_EQ(read_names(file("person\ntraffic light\n\n"))->size(), 2U);
}

TEST(ViewTruth, MovesAgainstTheViewAndIsCutAtTheBorder) {
  const std::vector<Truth> labels{{0, {100, 50, 20, 40}}, {1, {0, 50, 20, 40}}};
  const auto seen = [&labels](double x, double y) {
    const auto inside = truth_in_view(labels, 2, {640, 512}, {320, 240}, {x, y});
    EXPECT_EQ(inside.size(), 1U) << "the other one is outside";
    return inside.at(0);
  };
  EXPECT_EQ(seen(30.5, 10.25).box, (Box{69.5, 39.75, 20, 40}));
  EXPECT_EQ(seen(30.5, 10.25).kind, TruthKind::kObject);
  EXPECT_EQ(seen(105.0, 0.0).box, (Box{0, 50, 15, 40}));
  EXPECT_EQ(seen(105.0, 0.0).kind, TruthKind::kObject);
  EXPECT_EQ(seen(111.0, 0.0).kind, TruthKind::kIgnored) << "mostly outside";
}

TEST(ViewTruth, WhatLiesBeyondTheStillIsACrowdOfEveryClass) {
  const auto seen = truth_in_view({}, 2, {640, 512}, {320, 240}, {-10.0, 300.0});
  ASSERT_EQ(seen.size(), 4U);  // a band to the left and one below, for two classes
  for (const Truth& one : seen) EXPECT_EQ(one.kind, TruthKind::kCrowd);
  EXPECT_EQ(seen[0].box, (Box{0, 0, 10, 240}));
  EXPECT_EQ(seen[2].box, (Box{0, 212, 320, 28}));
  EXPECT_EQ(seen[3].label, 1);
}

TEST(Bootstrap, DrawsAsManyScenesAsThereAreAllAlikeOften) {
  std::vector<int> often(5, 0);
  for (std::uint64_t draw = 0; draw < 2000; ++draw) {
    const std::vector<int> times = drawn_scenes(5, 7, draw);
    EXPECT_EQ(std::accumulate(times.begin(), times.end(), 0), 5);
    for (std::size_t i = 0; i < often.size(); ++i) often[i] += times[i];
  }
  for (const int times : often) EXPECT_NEAR(times, 2000, 200);  // 5 standard deviations of 40
  EXPECT_EQ(drawn_scenes(5, 7, 3), drawn_scenes(5, 7, 3));
  EXPECT_NE(drawn_scenes(50, 7, 3), drawn_scenes(50, 8, 3));
}

TEST(Bootstrap, TheIntervalIsTheMiddleOfTheNumbers) {
  std::vector<double> values(1001);
  std::iota(values.begin(), values.end(), 0.0);
  const Interval interval = interval_95(values);
  EXPECT_DOUBLE_EQ(interval.low, 25.0);
  EXPECT_DOUBLE_EQ(interval.high, 975.0);
  EXPECT_DOUBLE_EQ(interval_95({3.0, std::nan("")}).high, 3.0);
  EXPECT_TRUE(std::isnan(interval_95({std::nan("")}).low));
}

// --- average precision: average_precision_test.py compares it with another implementation on random pictures

// The bootstrap relies on it.
TEST(AveragePrecision, AWeightIsARepetition) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> near(0.0, 12.0);
  std::vector<ImageBoxes> images(7);
  for (ImageBoxes& image : images) {
    for (const double x : {0.0, 100.0}) {
      image.truth.push_back({0, {x, 0, 40, 40}, TruthKind::kObject});
      for (int i = 0; i < 2; ++i) image.detections.push_back({0, near(random), {x + near(random), 0, 40, 40}});
    }
  }
  const std::vector<int> weights{2, 0, 1, 3, 1, 0, 1};
  std::vector<ImageBoxes> repeated;
  for (std::size_t i = 0; i < images.size(); ++i) {
    for (int n = 0; n < weights[i]; ++n) repeated.push_back(images[i]);
  }
  const ApScore weighted = Evaluator(images, 1).score(weights);
  const ApScore drawn = Evaluator(repeated, 1).score();
  EXPECT_NEAR(weighted.ap, drawn.ap, 1e-12);
  EXPECT_EQ(weighted.objects, drawn.objects);
  EXPECT_NE(weighted.ap, Evaluator(images, 1).score().ap);
}

}  // namespace bolo::tools::detect::boxes_test
