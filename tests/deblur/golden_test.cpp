// The solvers against an independent Lasso on all 2^levels unknowns (golden/generate.py).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "src/deblur/solver.hpp"

namespace bolo::deblur {
namespace {

// What solver.hpp says of one pixel: kelvin in, kelvin out.
double estimate(const Settings& settings, const std::vector<float>& y, const std::vector<int>& received) {
  StreamFormat format;
  format.geometry = {1, 1};
  format.type = PixelType::kFloat32;
  format.scale = {Unit::kKelvin, 1.0, 0.0};
  format.frame_period_s = settings.period_s;
  auto solver = Solver::create(settings, format, PixelType::kFloat32);
  EXPECT_TRUE(solver) << solver.error().message;
  if (!solver) return std::nan("");
  std::vector<const void*> planes(y.size());
  for (std::size_t i = 0; i < y.size(); ++i) planes[i] = received[i] != 0 ? &y[i] : nullptr;
  const WindowView window{planes, settings.window - 1 - settings.lookahead};
  float result = 0.0F;
  (*solver)->prepare(window);
  (*solver)->solve(window, {0, 0, 1, 1}, &result);
  return static_cast<double>(result);
}

struct Error {
  double squares = 0.0;
  double largest = 0.0;
  int cases = 0;
  double rms() const { return std::sqrt(squares / cases); }
};

// Fixed iterations are too few where nothing but lambda pulls at a direction and the way is long: windows of white
// noise of 20 K with lost frames, and rates at which a frame needs more than one unknown. Scenes do not look like the
// first; for the second `exact` is there.
bool fixed_iterations_reach(const nlohmann::json& c) {
  const auto received = c.at("received").get<std::vector<int>>();
  const bool gap = std::find(received.begin(), received.end(), 0) != received.end();
  const bool reduces = c.at("period_s").get<double>() / c.at("tau_s").get<double>() < 2.1;
  return reduces && !(gap && c.at("name") == "noise");
}

// Errors in K by lambda.
std::map<double, Error> errors_of(Method method) {
  std::ifstream file(BOLO_GOLDEN_FILE);
  const nlohmann::json golden = nlohmann::json::parse(file);
  std::map<double, Error> errors;
  for (const auto& c : golden.at("cases")) {
    if (method != Method::kExact && !fixed_iterations_reach(c)) continue;
    Settings settings;
    settings.method = method;
    settings.period_s = c.at("period_s");
    settings.tau_s = c.at("tau_s");
    settings.levels = c.at("levels");
    const double lambda = c.at("half_square_lambda");
    settings.lambda = lambda * 2.0 * settings.kappa;
    const auto y = c.at("y_k").get<std::vector<float>>();
    settings.window = static_cast<int>(y.size());
    const double error =
        estimate(settings, y, c.at("received").get<std::vector<int>>()) - c.at("last_bin_k").get<double>();
    Error& e = errors[lambda];
    e.squares += error * error;
    e.largest = std::max(e.largest, std::abs(error));
    ++e.cases;
  }
  return errors;
}

TEST(Golden, ExactAgreesWithAnIndependentLasso) {
  const auto errors = errors_of(Method::kExact);
  ASSERT_EQ(errors.size(), 3U);
  for (const auto& [lambda, error] : errors) {
    EXPECT_LE(error.rms(), 1e-3) << "lambda " << lambda;
    EXPECT_LE(error.largest, 2e-3) << "lambda " << lambda;
    RecordProperty("exact_rms_k_" + std::to_string(lambda), std::to_string(error.rms()));
  }
}

TEST(Golden, TheFastMethodsAgreeWithAnIndependentLasso) {
  for (const Method method : {Method::kAdmm, Method::kDual}) {
    const auto errors = errors_of(method);
    ASSERT_EQ(errors.size(), 3U);
    for (const auto& [lambda, error] : errors) {
      EXPECT_LE(error.rms(), 5e-3) << name(method) << ", lambda " << lambda;
      EXPECT_LE(error.largest, 50e-3) << name(method) << ", lambda " << lambda;
      RecordProperty(std::string(name(method)) + "_rms_k_" + std::to_string(lambda), std::to_string(error.rms()));
    }
  }
}

}  // namespace
}  // namespace bolo::deblur
