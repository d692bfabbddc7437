// Requirements of PlaneSolver on every PixelMethod: a lambda for each pixel, and any mean of two bins.
#include "src/deblur/method.hpp"
#include "tests/deblur/inputs.hpp"
#include "tests/deblur/solve.hpp"

namespace bolo::deblur::method_test {

using namespace testing;

constexpr std::size_t kPixels = 45;

struct Way {
  const char* name;
  std::unique_ptr<PixelMethod> (*make)(const StreamTask&);
  int levels;
};

StreamTask task_of(int levels, double lambda_half) {
  StreamTask task{.settings = {.levels = levels}, .input = testing::kelvin({}), .output = PixelType::kFloat32};
  task.settings.lambda = lambda_half * 2.0 * task.settings.kappa;
  return task;
}

class Methods : public ::testing::TestWithParam<Way> {
 protected:
  Methods() : planes_(17, std::vector<float>(kPixels)) {
    InputSource source(17, 0.45, 3U);
    for (std::size_t pixel = 0; pixel < kPixels; ++pixel) {
      const std::vector<double> y = source.pixel(testing::kInputs[pixel % std::size(testing::kInputs)]);
      for (std::size_t slot = 0; slot < y.size(); ++slot) planes_[slot][pixel] = static_cast<float>(y[slot]);
    }
    for (const auto& plane : planes_) pointers_.push_back(plane.data());
    pattern_ = pattern_of({pointers_, 16});
  }

  std::vector<float> run(double lambda_half, const Published& published, const float* lambda = nullptr) const {
    const auto method = GetParam().make(task_of(GetParam().levels, lambda_half));
    method->prepare(pattern_);
    std::vector<float> out(kPixels);
    const PixelRun run{.planes = pointers_.data(),
                       .input = PixelType::kFloat32,
                       .output = PixelType::kFloat32,
                       .end = kPixels,
                       .out = out.data(),
                       .published = published,
                       .lambda = lambda};
    method->run(run);
    return out;
  }

  int last_bin() const { return std::min(1 << GetParam().levels, 16) - 1; }
  Published last() const { return {last_bin(), last_bin()}; }

 private:
  std::vector<std::vector<float>> planes_;
  std::vector<const void*> pointers_;
  Pattern pattern_;
};

TEST_P(Methods, TheSameLambdaInEveryPixelGivesTheSameBits) {
  const std::vector<float> lambda(kPixels, 0.05F);
  EXPECT_EQ(run(0.05, last(), lambda.data()), run(0.05, last()));
}

TEST_P(Methods, EachPixelHasItsOwnLambda) {
  const auto run_with = [this](const std::vector<float>& lambda) { return run(0.1, last(), lambda.data()); };
  std::vector<float> lambda(kPixels);
  for (std::size_t i = 0; i < kPixels; ++i) lambda[i] = i % 3 == 0 ? 0.02F : 0.2F;
  const std::vector<float> mixed = run_with(lambda);
  const std::vector<float> all_low = run_with(std::vector<float>(kPixels, 0.02F));
  const std::vector<float> all_high = run_with(std::vector<float>(kPixels, 0.2F));
  bool differs = false;
  for (std::size_t i = 0; i < kPixels; ++i) {
    EXPECT_EQ(mixed[i], i % 3 == 0 ? all_low[i] : all_high[i]) << i;
    differs = differs || all_low[i] != all_high[i];
  }
  EXPECT_TRUE(differs);
}

TEST_P(Methods, LambdaOfPixelsIsThatOfSettings) {
  const std::vector<float> lambda(kPixels, 0.05F);
  const std::vector<float> by_pixel = run(0.1, last(), lambda.data());
  const std::vector<float> by_settings = run(0.05, last());
  for (std::size_t i = 0; i < kPixels; ++i) EXPECT_NEAR(by_pixel[i], by_settings[i], 0.05F) << i;
}

TEST_P(Methods, AnyTwoBinsArePublished) {
  const int last = last_bin();
  const std::vector<float> first = run(0.05, {last - 2, last - 2});
  const std::vector<float> second = run(0.05, {last, last});
  const std::vector<float> both = run(0.05, {last - 2, last, 0.25F, 0.75F});
  EXPECT_NE(first, second);
  for (std::size_t i = 0; i < kPixels; ++i) {
    EXPECT_NEAR(both[i], 0.25F * first[i] + 0.75F * second[i], 1e-3F) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Method, Methods,
                         ::testing::Values(Way{"admm", make_admm, 7}, Way{"admm_long_bins", make_admm, 3},
                                           Way{"dual", make_dual, 7}, Way{"exact", make_exact, 7},
                                           Way{"exact_long_bins", make_exact, 3}),
                         [](const auto& each) { return std::string(each.param.name); });

}  // namespace bolo::deblur::method_test
