// Boxes, label files, labels as a moving camera sees them, the bootstrap, and average precision.
#include "tools/lab/detect/boxes.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::tools::detect::boxes_test {

class Labels : public ::testing::Test {
 protected:
  std::filesystem::path file(const std::string& text) const {
    std::ofstream(scratch_ / "labels.txt") << text;
    return scratch_ / "labels.txt";
  }
  const Scratch scratch_;
  const std::vector<JudgedClass> classes_{{"person", 1}, {"car", 3}};
};

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
