// From a network's outputs to judged boxes, and the descriptions of detectors.
#include "tools/lab/detect/detector.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::tools::detect::detector_test {

// What good ones become is seen on real stills (verb_test.cpp).
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
  // Classes dog, car, person. The second row is a car half outside, the third the same person again, less surely.
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

// --- Descriptions of detectors: those that come with Bolo, and wrong ones.

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

class Description : public ::testing::Test {
 protected:
  Result<DetectorDescription> read(std::string text) const {
    std::ofstream(scratch_ / "one.toml") << text;
    return read_description(scratch_ / "one.toml");
  }

  const Scratch scratch_;
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

}  // namespace bolo::tools::detect::detector_test
