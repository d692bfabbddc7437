// Rolling read-out: rows read one after the other, published at one frame time.
#include "src/deblur/grid.hpp"
#include "tests/deblur/solve.hpp"
#include "tests/refusal.hpp"

namespace bolo::deblur::row_delay_test {

constexpr Geometry kFrame{5, 24};

Settings settings_for(Method method, int lookahead) {
  return {.method = method, .lambda = 1e-4, .lookahead = lookahead};
}

std::unique_ptr<Solver> make(const Settings& s, double row_delay_s, int row_step = 1) {
  StreamFormat format = testing::kelvin(kFrame);
  format.row_step = row_step;
  return testing::make(s, format, PixelType::kFloat32, row_delay_s);
}

// Response of a rolling read-out to an input that has long been rising by `slope` K/s everywhere: y = x(t - tau).
class Ramp {
 public:
  Ramp(const Settings& s, double row_delay_s, double slope) : target_(s.window - 1 - s.lookahead) {
    for (int slot = 0; slot < s.window; ++slot) {
      auto& plane = planes_.emplace_back();
      for (int row = 0; row < kFrame.height; ++row) {
        const double t = slot * s.period_s + row * row_delay_s;
        plane.insert(plane.end(), static_cast<std::size_t>(kFrame.width),
                     static_cast<float>(300.0 + slope * (t - s.tau_s)));
      }
    }
    for (const auto& plane : planes_) pointers_.push_back(plane.data());
  }
  Ramp(const Ramp&) = delete;
  Ramp& operator=(const Ramp&) = delete;
  WindowView view() const { return {pointers_, target_}; }

 private:
  int target_;
  std::vector<std::vector<float>> planes_;
  std::vector<const void*> pointers_;
};

std::vector<float> solve(const Settings& s, const WindowView& view, double row_delay_s, int row_step = 1) {
  return testing::whole_frame(*make(s, row_delay_s, row_step), view, kFrame);
}

// Largest difference from row 0, K.
double skew(const std::vector<float>& out) {
  double largest = 0.0;
  for (const float value : out) {
    largest = std::max(largest, std::abs(static_cast<double>(value) - static_cast<double>(out.front())));
  }
  return largest;
}

class RowDelay : public ::testing::TestWithParam<std::tuple<Method, double>> {};

// Delay of the last row in periods: below and above a half, one, and two.
TEST_P(RowDelay, StraightensAMovingRamp) {
  const auto [method, periods] = GetParam();
  const Settings s = settings_for(method, 2);
  const double row_delay_s = periods * s.period_s / (kFrame.height - 1);
  const double slope = 400.0;  // K/s: 2 K a frame
  const Ramp ramp(s, row_delay_s, slope);
  const double before = skew(solve(s, ramp.view(), 0.0));
  const double after = skew(solve(s, ramp.view(), row_delay_s));
  EXPECT_GT(before, 0.9 * slope * s.period_s * std::abs(periods));
  EXPECT_LT(after, 0.02 * before);
}

INSTANTIATE_TEST_SUITE_P(Solver, RowDelay,
                         ::testing::Combine(::testing::Values(Method::kAdmm, Method::kExact, Method::kInverse),
                                            ::testing::Values(0.3, 0.9, 2.4, -0.4)),
                         [](const auto& each) {
                           const double periods = std::get<1>(each.param);
                           return std::string(name(std::get<0>(each.param))) + (periods < 0 ? "_before_" : "_") +
                                  std::to_string(std::lround(std::abs(periods) * 10.0));
                         });

class RowDelayOf : public ::testing::TestWithParam<Method> {};

// At the window's end, rows up to half a period late have only the last bin; rows later than that are corrected.
TEST_P(RowDelayOf, IsLimitedToTheLastBinWithoutLookAhead) {
  const Settings s = settings_for(GetParam(), 0);
  const double row_delay_s = 2.0 * s.period_s / (kFrame.height - 1);
  const double slope = 400.0;
  const Ramp ramp(s, row_delay_s, slope);
  const std::vector<float> out = solve(s, ramp.view(), row_delay_s);
  const std::vector<float> plain = solve(s, ramp.view(), 0.0);
  EXPECT_EQ(out[0], plain[0]);
  for (int row = 0; row < kFrame.height; ++row) {
    const auto pixel = static_cast<std::size_t>(row * kFrame.width);
    const double late_s = row * row_delay_s;
    const double gained = std::max(0.0, late_s - 0.5 * s.period_s) * slope;
    EXPECT_NEAR(static_cast<double>(plain[pixel]) - static_cast<double>(out[pixel]), gained, 0.02 + 0.02 * gained)
        << row;
  }
}

TEST_P(RowDelayOf, CountsSensorRows) {
  const Settings s = settings_for(GetParam(), 1);
  const Ramp ramp(s, 80e-6, 400.0);
  EXPECT_EQ(solve(s, ramp.view(), 40e-6, 2), solve(s, ramp.view(), 80e-6, 1));
}

TEST(RowTime, LongerThanTheWindowIsRefused) {
  expect_refused(Solver::create(Settings(), testing::kelvin(kFrame), PixelType::kFloat32, 0.01), {"row_delay_s"});
}

INSTANTIATE_TEST_SUITE_P(Solver, RowDelayOf, ::testing::Values(Method::kAdmm, Method::kExact, Method::kInverse),
                         [](const auto& each) { return std::string(name(each.param)); });

}  // namespace bolo::deblur::row_delay_test
