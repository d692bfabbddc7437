// From a picture to a network's input, and from its outputs to boxes, on small made-up tensors.
#include "tools/lab/detect/detector.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::tools::detect::detector_test {

TEST(Picture, BecomesChannelsInOrderAndScale) {
  DetectorDescription d;
  d.input = {4, 2};
  d.order = ChannelOrder::kBgr;
  d.red = {10.0, 2.0};
  d.blue = {20.0, 0.5};
  const Levels levels{0, 10, 20, 30, 40, 50, 60, 70};
  const Tensor input = input_of(levels, {4, 2}, d);
  EXPECT_EQ(input.shape, (std::vector<int>{1, 3, 2, 4}));
  ASSERT_EQ(input.values.size(), 24U);
  EXPECT_FLOAT_EQ(input.values[1], (10.0F - 20.0F) * 0.5F);       // blue comes first
  EXPECT_FLOAT_EQ(input.values[8 + 7], 70.0F);                    // green as it is
  EXPECT_FLOAT_EQ(input.values[16 + 2], (20.0F - 10.0F) * 2.0F);  // red last
}

TEST(Picture, IsResizedBetweenTheCentresOfPixels) {
  DetectorDescription d;
  d.input = {4, 4};
  // Twice as large: weights 1/4 and 3/4, borders as they are (what OpenCV's INTER_LINEAR gives).
  const Tensor twice = input_of({0, 100, 200, 40}, {2, 2}, d);
  EXPECT_EQ(std::vector<float>(twice.values.begin(), twice.values.begin() + 4), (std::vector<float>{0, 25, 75, 100}));
  EXPECT_FLOAT_EQ(twice.values[4], 50.0F);
}

TEST(DecodeYolo, ReadsRowsOfEveryOutput) {
  const std::vector<Tensor> outputs{{{2, 7},
                                     {0.5F, 0.5F, 0.25F, 0.5F, 0.9F, 0.8F, 0.004F,  //
                                      0.1F, 0.1F, 0.1F, 0.1F, 0.001F, 0.0F, 0.0F}},
                                    {{1, 7}, {0.25F, 0.75F, 0.5F, 0.1F, 1.0F, 0.3F, 0.6F}}};
  const auto found = must(decode_yolo(outputs, {400, 200}, 0.01));
  ASSERT_EQ(found->size(), 3U);
  EXPECT_EQ((*found)[0].label, 0);
  EXPECT_NEAR((*found)[0].score, 0.8, 1e-6);  // the class's score has the objectness in it already
  EXPECT_EQ((*found)[0].box, (Box{150, 50, 100, 100}));
  EXPECT_EQ((*found)[2].label, 1);
  EXPECT_NEAR((*found)[2].box.y, 140.0, 1e-4);
  expect_error(decode_yolo(std::vector<Tensor>{{{2, 5}, std::vector<float>(10)}}, {400, 200}, 0.01), {"2x5"});
  EXPECT_FALSE(decode_yolo(std::vector<Tensor>{Tensor{}}, {400, 200}, 0.01));
}

// One stride of 32 over 64 x 64: four places; distances are sure of single bins.
class Nanodet : public ::testing::Test {
 protected:
  Tensor scores_{{1, 4, 2}, {0, 0, 0, 0.7F, 0, 0, 0.001F, 0}};
  Tensor distances_{{1, 4, 16}, std::vector<float>(64, 0.0F)};
  const GflLayout layout_{{32}, 4};

  void SetUp() override {
    const std::array<std::size_t, 4> bins{1, 0, 1, 2};  // left, upper, right, lower
    for (std::size_t side = 0; side < 4; ++side) distances_.values[16 + 4 * side + bins[side]] = 100.0F;
  }
};

TEST_F(Nanodet, ReadsDistancesFromTheMiddleOfTheCell) {
  for (const auto& outputs : {std::vector<Tensor>{scores_, distances_}, std::vector<Tensor>{distances_, scores_}}) {
    const auto found = must(decode_nanodet(outputs, {64, 64}, layout_, 0.01));
    ASSERT_EQ(found->size(), 1U);
    const auto& [label, score, box] = found->front();
    EXPECT_EQ(label, 1);
    EXPECT_NEAR(score, 0.7, 1e-6);
    EXPECT_NEAR(box.x, 48.0 - 32.0, 1e-6);
    EXPECT_NEAR(box.y, 16.0, 1e-6);
    EXPECT_NEAR(box.width, 64.0, 1e-6);
    EXPECT_NEAR(box.height, 64.0, 1e-6);
  }
  expect_error(decode_nanodet(std::vector<Tensor>{scores_, distances_}, {64, 64}, {{32}, 8}, 0.01), {"1x4x16"});
  EXPECT_FALSE(decode_nanodet(std::vector<Tensor>{scores_, distances_}, {64, 64}, {{16}, 4}, 0.01));
  EXPECT_FALSE(decode_nanodet({}, {64, 64}, layout_, 0.01));
}

TEST_F(Nanodet, TakesTheMeanOfADistribution) {
  // ln 3 against 0: three quarters at bin 3, a quarter at bin 1; the others far below.
  const std::array<float, 4> logits{-100.0F, 0.0F, -100.0F, std::log(3.0F)};
  std::copy(logits.begin(), logits.end(), distances_.values.begin() + 16);
  const auto found = must(decode_nanodet(std::vector<Tensor>{scores_, distances_}, {64, 64}, layout_, 0.01));
  EXPECT_NEAR((*found)[0].box.x, 48.0 - 2.5 * 32.0, 1e-3);
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
