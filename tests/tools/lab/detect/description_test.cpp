// Descriptions of detectors: those that come with Bolo, and wrong ones.
#include "tools/lab/detect/description.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::tools::detect {
namespace {

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
  static std::string with(const std::string& old, const std::string& instead) {
    std::string text = kGood;
    text.replace(text.find(old), old.size(), instead);
    return text;
  }
  const Scratch scratch_;
};

TEST_F(Description, SaysAllThatANetworkNeeds) {
  const auto d = read(kGood);
  ASSERT_TRUE(d) << d.error().message;
  EXPECT_EQ(d->name, "one");
  EXPECT_EQ(d->files.format, NetworkFormat::kDarknet);
  EXPECT_EQ(d->files.graph, "one.cfg");
  EXPECT_EQ(d->files.least_score, 0.05);
  EXPECT_EQ(d->input, (Geometry{320, 256}));
  EXPECT_EQ(d->order, ChannelOrder::kBgr);
  EXPECT_EQ(d->red.mean, 12.5);
  EXPECT_EQ(d->output, OutputKind::kYolo);
  EXPECT_EQ(d->class_names, "person, car");
}

TEST_F(Description, RefusesWhatIsWrongInOneLineThatSaysWhere) {
  struct Wrong {
    std::string text;
    const char* says;
  };
  const std::vector<Wrong> wrong{{with("format = \"darknet\"", "format = \"caffe\""), "one.toml:3"},
                                 {with("width = 320", "width = 8"), "one.toml:7"},
                                 {with("width = 320", "widht = 320"), "one.toml:7"},
                                 {with("mean_red = 12.5", "mean_red = \"12.5\""), "one.toml:10"},
                                 {with("kind = \"yolo\"", "kind = \"ssd\""), "one.toml:12"},
                                 {with("least_score = 0.05", "least_score = 2"), "one.toml:16"},
                                 {with("least_score = 0.05", "least_score = 0.9"), "truth_score is below least_score"},
                                 {with("graph = \"one.cfg\"\n", ""), "network.graph is missing"},
                                 {with("weights = \"one.weights\"\n", ""), "network.weights is missing"},
                                 {with("format = \"darknet\"", "format = \"onnx\""), "network.weights belongs to"},
                                 {with("names = \"person, car\"\n", ""), "either classes.names or classes.file"},
                                 {with("names = ", "file = \"x\"\nnames = "), "either classes.names or classes.file"},
                                 {with("name = \"one\"\n", ""), "name is missing"},
                                 {with("[output]\n", "[output\n"), "one.toml:11"},
                                 {with("kind = \"yolo\"", "kind = \"nanodet_gfl\"\nstrides = []"), "strides"}};
  for (const Wrong& one : wrong) {
    const auto refused = read(one.text);
    expect_refused(refused, {one.says});
    EXPECT_EQ(refused.error().message.find('\n'), std::string::npos) << refused.error().message;
  }
  EXPECT_FALSE(read_description(scratch_ / "none.toml"));
}

TEST_F(Description, FindsItsFilesInTheFolderOfNetworks) {
  const auto d = read(kGood);
  ASSERT_TRUE(d);
  const auto missing = with_files_in(*d, scratch_.path());
  expect_error(missing, {"one.cfg: not there"});
  for (const char* name : {"one.cfg", "one.weights"}) std::ofstream(scratch_ / name) << "x";
  const auto there = with_files_in(*d, scratch_.path());
  ASSERT_TRUE(there) << there.error().message;
  EXPECT_EQ(there->files.weights, scratch_ / "one.weights");
}

TEST(Descriptions, OfBoloAreGood) {
  int read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(BOLO_DETECTORS)) {
    const auto d = read_description(entry.path());
    EXPECT_TRUE(d) << d.error().message;
    ++read;
  }
  EXPECT_GE(read, 3);
}

}  // namespace
}  // namespace bolo::tools::detect
