// Boxes, label files, labels in a moving camera's view, the bootstrap, and average precision.
#include <png.h>

#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tools/lab/detect/boxes.hpp"
#include "tools/lab/detect/detector.hpp"
#include "tools/lab/detect/table.hpp"

namespace bolo::tools::detect::detect_test {

class Labels : public ScratchTest {
 protected:
  std::filesystem::path file(const std::string& text) const { return scratch_.text("labels.txt", text); }
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
  ASSERT_EQ(seen.size(), 4U);  // left and lower band, for two classes
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

// --- Average precision; average_precision_test.py compares it with another implementation on random pictures.

// The bootstrap relies on this.
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

// --- Network outputs to judged boxes.

// Valid outputs are tested on real stills (verb_test.cpp).
TEST(Outputs, OfOtherShapesAreRefused) {
  expect_error(decode_yolo(std::vector<Tensor>{{{2, 5}, std::vector<float>(10)}}, {400, 200}, 0.01), {"2x5"});
  EXPECT_FALSE(decode_yolo(std::vector<Tensor>{Tensor{}}, {400, 200}, 0.01));
  const std::vector<Tensor> of_one_stride{{{1, 4, 2}, std::vector<float>(8)}, {{1, 4, 16}, std::vector<float>(64)}};
  EXPECT_TRUE(decode_nanodet(of_one_stride, {64, 64}, {{32}, 4}, 0.01));
  expect_error(decode_nanodet(of_one_stride, {64, 64}, {{32}, 8}, 0.01), {"1x4x16"});
  EXPECT_FALSE(decode_nanodet(of_one_stride, {64, 64}, {{16}, 4}, 0.01));
  EXPECT_FALSE(decode_nanodet({}, {64, 64}, {{32}, 4}, 0.01));
}

TEST(Suppression, KeepsTheBestOfEachClass) {
  const std::vector<Detection> kept = suppressed(
      {{0, 0.5, {0, 0, 10, 10}}, {0, 0.9, {1, 0, 10, 10}}, {1, 0.4, {1, 0, 10, 10}}, {0, 0.3, {8, 0, 10, 10}}}, 0.5);
  ASSERT_EQ(kept.size(), 3U);
  EXPECT_EQ(kept[0].score, 0.9);
  EXPECT_EQ(kept[1].label, 1);
  EXPECT_EQ(kept[2].score, 0.3);
}

TEST(Detector, GivesJudgedClassesInThePicturesPixels) {
  DetectorDescription d;
  d.input = {200, 100};
  // Classes dog, car, person. The second row is a car half outside, the third the same person with a lower score.
  const std::vector<Tensor> outputs{{{3, 8}, {0.5F,  0.5F, 0.5F, 0.5F, 1.0F, 0.9F, 0.0F, 0.8F,  //
                                              0.0F,  0.5F, 0.2F, 0.2F, 1.0F, 0.0F, 0.6F, 0.0F,  //
                                              0.51F, 0.5F, 0.5F, 0.5F, 1.0F, 0.0F, 0.0F, 0.7F}}};
  const auto network = [&outputs](const Tensor&) { return Result<std::vector<Tensor>>(outputs); };
  Detector detector(d, network, {"dog", "car", "person"}, {{"person", 1}, {"bicycle", 2}, {"car", 3}});
  EXPECT_TRUE(detector.knows(0));
  EXPECT_FALSE(detector.knows(1));
  const auto found = must(detector.detect(Levels(400 * 200, 0.0F), {400, 200}));
  ASSERT_EQ(found->size(), 2U);
  EXPECT_EQ((*found)[0].label, 0);
  EXPECT_EQ((*found)[0].box, (Box{100, 50, 200, 100}));
  EXPECT_EQ((*found)[1].label, 2);
  EXPECT_NEAR((*found)[1].box.width, 40.0, 1e-4);  // of 80
}

// --- Detector descriptions: those shipped with Bolo, and invalid ones.

constexpr const char* kGood = R"(name = "one"
[network]
format = "darknet"
graph = "one.cfg"
weights = "one.weights"
[input]
width = 320
height = 256
order = "bgr"
mean_red = 12.5
[output]
kind = "yolo"
[classes]
names = "person, car"
[detections]
least_score = 0.05
)";

class Description : public ScratchTest {
 protected:
  Result<DetectorDescription> read(const std::string& text) const {
    return read_description(scratch_.text("one.toml", text));
  }
};

TEST_F(Description, RefusesWhatIsWrongInOneLineThatSaysWhere) {
  struct Wrong {
    const char* part;
    const char* instead;
    const char* message;
  };
  for (const Wrong& one : {Wrong{"\"darknet\"", "\"caffe\"", "one.toml:3"},
                           {"width = 320", "width = 8", "one.toml:7"},
                           {"width = 320", "widht = 320", "one.toml:7"},
                           {"12.5", "\"12.5\"", "one.toml:10"},
                           {"\"yolo\"", "\"ssd\"", "one.toml:12"},
                           {"least_score = 0.05", "least_score = 2", "one.toml:16"},
                           {"least_score = 0.05", "least_score = 0.9", "truth_score is below least_score"},
                           {"graph = \"one.cfg\"\n", "", "network.graph is missing"},
                           {"weights = \"one.weights\"\n", "", "network.weights is missing"},
                           {"\"darknet\"", "\"onnx\"", "network.weights belongs to"},
                           {"names = \"person, car\"\n", "", "either classes.names or classes.file"},
                           {"names = ", "file = \"x\"\nnames = ", "either classes.names or classes.file"},
                           {"name = \"one\"\n", "", "name is missing"},
                           {"[output]\n", "[output\n", "one.toml:11"},
                           {"\"yolo\"", "\"nanodet_gfl\"\nstrides = []", "strides"}}) {
    std::string text = kGood;
    expect_refused(read(text.replace(text.find(one.part), std::strlen(one.part), one.instead)), {one.message});
  }
  EXPECT_FALSE(read_description(scratch_ / "none.toml"));
}

TEST(Descriptions, OfBoloAreGood) {
  int read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(BOLO_DETECTORS)) {
    must(read_description(entry.path()));
    ++read;
  }
  EXPECT_GE(read, 3);
}

// --- Views of a still: a bright box in the picture must lie where the moved label says.

constexpr Geometry kStill{160, 128};
constexpr Geometry kPicture{96, 80};
constexpr Box kBright{60, 50, 32, 20};

// A grey still with a bright box and its label.
std::filesystem::path make_still(const Scratch& folder) {
  std::vector<unsigned char> grey(kStill.pixels(), 80);
  for (int y = 50; y < 70; ++y) {
    for (int x = 60; x < 92; ++x) grey[static_cast<std::size_t>(y * kStill.width + x)] = 200;
  }
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(kStill.width);
  image.height = static_cast<png_uint_32>(kStill.height);
  image.format = PNG_FORMAT_GRAY;
  const std::filesystem::path file = folder / "still.png";
  EXPECT_NE(png_image_write_to_file(&image, file.c_str(), 0, grey.data(), 0, nullptr), 0);
  std::ofstream(folder / "still.txt") << "1 0.475 0.46875 0.2 0.15625\n";
  return file;
}

std::filesystem::path make_trajectory(const Scratch& folder) {
  std::string text = "t_s,x_px,y_px\n";
  for (int i = 0; i <= 60; ++i) {
    const double t = i / 30.0;
    text += std::to_string(t) + "," + std::to_string(250.0 * t) + "," + std::to_string(30.0 * std::sin(4.0 * t)) + "\n";
  }
  return folder.text("hand.csv", text);
}

class Views : public ScratchTest {
 protected:
  const std::filesystem::path file_ = make_still(scratch_);
  const std::filesystem::path trajectory_ = make_trajectory(scratch_);
  const std::vector<JudgedClass> classes_{{"person", 1}};
};

TEST_F(Views, TheMovedLabelIsWhereTheObjectIsSeen) {
  const auto still = must(read_still(file_, classes_));
  ASSERT_TRUE(still->labelled);
  ASSERT_EQ(still->labels.size(), 1U);
  EXPECT_NEAR(still->labels[0].box.x, kBright.x, 1e-3);
  for (const View& view : {View{0, 0, 0.5, {21.25, 19.75}}, View{0, 0, 0.9, {34.0, 30.75}}}) {
    const auto clean = must(simulate(*still, trajectory_, view, kPicture));
    const auto truth = truth_in_view(still->labels, 1, still->size, kPicture, view.origin);
    ASSERT_EQ(truth.size(), 1U);
    const auto& seen = clean->truth[clean->targets[0]];
    int wrong = 0;
    for (int y = 0; y < kPicture.height; ++y) {
      for (int x = 0; x < kPicture.width; ++x) {
        const bool hot = seen[static_cast<std::size_t>(y * kPicture.width + x)] > 285.0F + 25.0F * 140.0F / 255.0F;
        const bool inside = intersection(truth[0].box, {x + 0.0, y + 0.0, 1.0, 1.0}) > 0.5;
        if (hot != inside) ++wrong;
      }
    }
    EXPECT_LE(wrong, 4);  // corners, where interpolation rounds the box
  }
}

TEST_F(Views, ShowEveryColumnAndDeblurringBringsTheEdgeBack) {
  const auto still = read_still(file_, classes_);
  const auto clean = must(simulate(*still, trajectory_, {0, 0, 0.5, {21.25, 19.5}}, kPicture));
  const auto shown = must(shown_columns(fidelity::read_out(*clean, 0.03, 1)));
  ASSERT_EQ(shown->size(), columns().size());
  const auto error = [&](const std::string& name) {
    const auto column = std::ranges::find(columns(), name, &Column::name);
    if (column == columns().end()) return std::nan("");
    return fidelity::rmse({(*shown)[static_cast<std::size_t>(column - columns().begin())]}, {(*shown)[kSharpColumn]});
  };
  EXPECT_EQ(error("sharp"), 0.0);
  EXPECT_GT(error("blurred"), 5.0);
  for (const char* name : {"inverse", "auto", "auto_1", "wiener"}) {
    EXPECT_LT(error(name), 0.8 * error("blurred")) << name;
  }
  EXPECT_LT(error("wiener"), error("wiener_10"));
}

TEST_F(Views, RefuseWhatIsTooShortOrMissing) {
  const auto hand = scratch_.text("short.csv", "t_s,x_px,y_px\n0,0,0\n0.1,1,1\n");
  const auto still = read_still(file_, classes_);
  expect_error(plan_views({*still}, {hand}, {}), {"short.csv: is shorter than"});
  EXPECT_FALSE(read_still(scratch_ / "none.png", classes_));
  std::ofstream(scratch_ / "still.txt") << "1 2 3\n";
  EXPECT_FALSE(read_still(file_, classes_));
}

}  // namespace bolo::tools::detect::detect_test
