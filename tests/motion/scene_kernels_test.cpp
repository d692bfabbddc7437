// Kernels that sum a scene's autocovariance, of every instruction set against their definitions.
#include "src/motion/kernels.hpp"
#include "tests/motion/reference.hpp"

namespace bolo::motion::kernels_test {

class SceneKernels : public testing::TestWithParam<std::string_view> {
 protected:
  const Kernels& kernels_ = best_kernels(GetParam());
};

TEST_P(SceneKernels, Covariance) {
  std::vector<float> share(1003);  // no multiple of the vector length
  for (std::size_t i = 0; i < share.size(); ++i) share[i] = 2e-3F / (1.0F + 0.002F * static_cast<float>(i));
  const std::array<std::array<double, 4>, 6> lines{{{-3.0, 0.011, 0.2, 0.004},
                                                    {-380.0, 0.4, 0.0, 0.0},
                                                    {250.0, -0.25, -9.0, 0.01},
                                                    {4.0, 0.3, 1.0, 0.0},
                                                    {7.0, 0, 0, 0}}};
  for (std::size_t line = 0; line < lines.size(); ++line) {
    const auto& [x, dx, y, dy] = lines[line];
    const double smooth = line % 2 == 0 ? 0.6 : 1.0;
    double want = 0.0;
    for (std::size_t i = 0; i < share.size(); ++i) {
      const auto n = static_cast<double>(i);
      want += share[i] * reference::covariance((x + n * dx) * (x + n * dx) + (y + n * dy) * (y + n * dy), smooth);
    }
    EXPECT_NEAR(kernels_.covariance(share.data(), share.size(), x, dx, y, dy, static_cast<float>(smooth)), want, 2e-7)
        << x;
  }
}

TEST_P(SceneKernels, WhatTwoTrailsHaveInCommon) {
  SceneTrail a;
  SceneTrail b;
  for (int i = 0; i < 21; ++i) {
    SceneTrail& t = i < 4 ? a : b;
    const auto v = static_cast<float>(i);
    t.x[t.count] = 0.9F * v;
    t.y[t.count] = 0.03F * v * v;
    t.doubt[t.count] = 0.1F * v;
    t.blur[t.count] = 0.02F * v;
    t.share[t.count++] = 1.0F / (1.0F + v);
  }
  for (const float smooth : {0.6F, 1.0F}) {
    double got[3];
    kernels_.correlate(a, b, {0.4F, -1.0F}, -1, 3, smooth, got);
    for (int j = -1; j <= 1; ++j) {
      double want = 0.0;
      for (int n = 0; n < a.count; ++n) {
        for (int m = 0; m < b.count; ++m) {
          const double x = a.x[n] - b.x[m] + 0.4F * static_cast<float>(j);
          const double y = a.y[n] - b.y[m] - static_cast<float>(j);
          const double r = std::hypot(x, y, a.doubt[n] - b.doubt[m]);
          want += a.share[n] * b.share[m] * reference::covariance(r * r + a.blur[n] + b.blur[m], smooth);
        }
      }
      EXPECT_NEAR(got[j + 1], want, 1e-5 * want) << j;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Isas, SceneKernels, testing::ValuesIn(reference::isas()),
                         [](const auto& each) { return std::string(each.param); });

}  // namespace bolo::motion::kernels_test
