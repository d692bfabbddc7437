// Networks through OpenCV: a convolution that the test writes itself, and files that are none.
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/lab/detect/onnx_file.hpp"
#include "tools/lab/detect/detector.hpp"

namespace bolo::tools::detect::networks_test {

constexpr Geometry kSize{12, 10};
constexpr std::array<float, 9> kSharpen{0, -0.5F, 0, -0.5F, 3, -0.5F, 0, -0.5F, 0};

class Networks : public ::testing::Test {
 protected:
  std::filesystem::path file(const std::string& name, const std::string& content) const {
    std::ofstream(scratch_ / name, std::ios::binary) << content;
    return scratch_ / name;
  }
  const Scratch scratch_;
};

TEST_F(Networks, AConvolutionIsApplied) {
  const auto onnx = file("sharpen.onnx", test::convolution_onnx(kSharpen, kSize.width, kSize.height));
  const auto network = must(open_network({NetworkFormat::kOnnx, onnx, {}, 0.0}));
  Tensor picture{{1, 1, kSize.height, kSize.width}, std::vector<float>(kSize.pixels())};
  for (std::size_t i = 0; i < picture.values.size(); ++i) picture.values[i] = static_cast<float>((i * 37) % 101);
  const auto sharp = must((*network)(picture));
  ASSERT_EQ(sharp->size(), 1U);
  EXPECT_EQ(sharp->front().shape, picture.shape);
  const auto value = [&](int x, int y) {
    const bool inside = x >= 0 && y >= 0 && x < kSize.width && y < kSize.height;
    return inside ? picture.values[static_cast<std::size_t>(y * kSize.width + x)] : 0.0F;
  };
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      const float wanted =
          3 * value(x, y) - 0.5F * (value(x - 1, y) + value(x + 1, y) + value(x, y - 1) + value(x, y + 1));
      EXPECT_NEAR(sharp->front().values[static_cast<std::size_t>(y * kSize.width + x)], wanted, 1e-3F) << x << ' ' << y;
    }
  }
  expect_refused((*network)({{1, 2, 3, 3}, std::vector<float>(18)}),
                 {"sharpen.onnx: does not take an input of 1x2x3x3"});
}

TEST_F(Networks, FilesThatAreNoneAreRefusedInOneLine) {
  const auto text = file("text.onnx", "not a network");
  const auto empty = file("empty.onnx", "");
  const std::vector<NetworkFiles> wrong{{NetworkFormat::kOnnx, scratch_ / "none.onnx", {}, 0.0},
                                        {NetworkFormat::kOnnx, text, {}, 0.0},
                                        {NetworkFormat::kOnnx, empty, {}, 0.0},
                                        {NetworkFormat::kDarknet, text, text, 0.0},
                                        {NetworkFormat::kDarknet, text, scratch_ / "none.weights", 0.0}};
  for (const NetworkFiles& files : wrong) expect_refused(open_network(files), {scratch_.path().string()});
}

}  // namespace bolo::tools::detect::networks_test
