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

TEST_F(Networks, ALearnedDeblurringIsAppliedToThePicture) {
  const auto onnx = file("sharpen.onnx", test::convolution_onnx(kSharpen, kSize.width, kSize.height));
  auto model = must(LearnedDeblurring::open(onnx));
  EXPECT_EQ(model->name(), "sharpen");
  Levels picture(kSize.pixels());
  for (std::size_t i = 0; i < picture.size(); ++i) picture[i] = static_cast<float>((i * 37) % 101);
  const auto sharp = must(model->apply(picture, kSize));
  const auto level = [&](int x, int y) {
    const bool inside = x >= 0 && y >= 0 && x < kSize.width && y < kSize.height;
    return inside ? picture[static_cast<std::size_t>(y * kSize.width + x)] : 0.0F;
  };
  int clamped = 0;
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      const float sum =
          3 * level(x, y) - 0.5F * (level(x - 1, y) + level(x + 1, y) + level(x, y - 1) + level(x, y + 1));
      const float wanted = std::clamp(sum, 0.0F, 255.0F);
      clamped += wanted != sum ? 1 : 0;
      EXPECT_NEAR((*sharp)[static_cast<std::size_t>(y * kSize.width + x)], wanted, 0.51F) << x << ' ' << y;
    }
  }
  EXPECT_GT(clamped, 0);
}

TEST_F(Networks, AModelThatGivesAnotherShapeIsRefused) {
  const auto onnx = file("three.onnx", test::convolution_onnx(kSharpen, kSize.width, kSize.height, 3));
  auto model = must(LearnedDeblurring::open(onnx));
  const auto refused = model->apply(Levels(kSize.pixels(), 1.0F), kSize);
  expect_error(refused, {"three.onnx: gives no image of 12x10"});
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
