#include "src/model/bolometer.hpp"
#include "tests/test.hpp"
#include "tools/lab/eval/paper_matrices.hpp"

namespace bolo::model::bolometer_test {

using namespace tools::paper;

constexpr double kTau = 0.011;

// Solves tau dy/dt + y = x by small explicit steps, independent of Theorem 1.
std::vector<double> integrate(const std::vector<double>& t, const std::vector<double>& input, double start) {
  constexpr int kSteps = 400'000;
  std::vector<double> y{start};
  const double span = t.back() - t.front();
  const double dt = span / kSteps;
  double state = start;
  std::size_t next = 1;
  for (int i = 0; i < kSteps; ++i) {
    const double now = dt * (i + 0.5);
    const auto bin = static_cast<std::size_t>(now / span * static_cast<double>(input.size()));
    const double middle = state + 0.5 * dt / kTau * (input[bin] - state);
    state += dt / kTau * (input[bin] - middle);
    if (next < t.size() && dt * (i + 1) >= t[next] - t.front() - 0.5 * dt) {
      y.push_back(state);
      ++next;
    }
  }
  return y;
}

TEST(ResponseMatrix, IsTheSolutionOfTheDifferentialEquation) {
  const std::vector<double> input{300, 305, 290, 290, 320, 310, 299, 301};
  for (const std::vector<double>& t :
       {std::vector<double>{0.0, 0.005, 0.010, 0.015, 0.020}, std::vector<double>{1.0, 1.003, 1.011, 1.0125, 1.021}}) {
    const std::vector<double> y = integrate(t, input, 295.0);
    ASSERT_EQ(y.size(), t.size());
    const Eigen::MatrixXd v = response_matrix(t, static_cast<int>(input.size()), kTau);
    const Eigen::VectorXd predicted =
        v * Eigen::Map<const Eigen::VectorXd>(input.data(), static_cast<Eigen::Index>(input.size()));
    const Eigen::VectorXd measured = constraints(t, y, kTau);
    for (Eigen::Index j = 0; j < measured.size(); ++j) EXPECT_NEAR(predicted(j), measured(j), 2e-3) << j;
  }
}

TEST(ResponseMatrix, AConstantInputIsAConstantOutput) {
  const std::vector<double> t{0.0, 0.005, 0.010};
  const Eigen::VectorXd gain = response_matrix(t, 4, kTau).rowwise().sum();
  const Eigen::VectorXd constant = constraints(t, std::vector<double>{1.0, 1.0, 1.0}, kTau);
  for (Eigen::Index j = 0; j < 2; ++j) EXPECT_NEAR(gain(j), constant(j), 1e-12);
}

TEST(Haar, IsOrthonormal) {
  for (const int bins : {1, 2, 16, 128}) {
    const Eigen::MatrixXd h = haar_matrix(bins);
    EXPECT_NEAR((h * h.transpose() - Eigen::MatrixXd::Identity(bins, bins)).cwiseAbs().maxCoeff(), 0.0, 1e-12) << bins;
  }
}

TEST(Haar, OrderIsScalingThenCoarseToFine) {
  const Eigen::MatrixXd h = haar_matrix(4);
  const double s = std::sqrt(0.5);
  Eigen::MatrixXd wanted(4, 4);
  wanted << 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, -0.5, -0.5, s, -s, 0, 0, 0, 0, s, -s;
  EXPECT_NEAR((h - wanted).cwiseAbs().maxCoeff(), 0.0, 1e-12);
}

// The exact reduction holds within this bound: 2.06 tanh(T / 4 tau) < 1 for 16 frames, i.e. T / tau < 2.1.
TEST(Reduction, BoundFollowsItsClosedForm) {
  for (const double ratio : {0.1, 0.4545, 1.0, 2.0, 3.0}) {
    EXPECT_NEAR(fine_column_bound(16, ratio * kTau, kTau), 2.06 * std::tanh(ratio / 4.0), 0.02) << ratio;
  }
  EXPECT_LT(fine_column_bound(16, 0.005, 0.011), 1.0);
  EXPECT_GT(fine_column_bound(16, 1.0 / 30.0, 0.010), 1.0);
}

}  // namespace bolo::model::bolometer_test
