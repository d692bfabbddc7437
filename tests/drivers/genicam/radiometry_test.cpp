// Radiance counts to kelvin.
#include "drivers/genicam/radiometry.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bolo::genicam::radiometry_test {
namespace {

const Planck kPlanck{17000.0, 1428.0, 1.0, 4000.0, 60.0};

double radiance(double kelvin) { return kPlanck.r / (std::exp(kPlanck.b / kelvin) - kPlanck.f); }
double count_of(double signal) { return kPlanck.j0 + kPlanck.j1 * signal; }

TEST(Radiometry, UndoesTheCamerasFormula) {
  for (const double kelvin : {240.0, 295.0, 300.0, 423.0}) {
    EXPECT_NEAR(kelvin_of(count_of(radiance(kelvin)), kPlanck, {}), kelvin, 1e-9);
  }
  EXPECT_EQ(kelvin_of(kPlanck.j0, kPlanck, {}), 0.0);
  EXPECT_EQ(kelvin_of(0.0, kPlanck, {}), 0.0);
}

TEST(Radiometry, TakesOutWhatIsReflectedAndAdded) {
  ObjectParameters object;
  object.emissivity = 0.8;
  object.transmission = 0.9;
  object.optics_transmission = 0.7;
  object.reflected_k = 280.0;
  object.atmosphere_k = 290.0;
  object.optics_k = 310.0;
  const double behind_air = 0.9 * (0.8 * radiance(330.0) + 0.2 * radiance(280.0)) + 0.1 * radiance(290.0);
  const double seen = 0.7 * behind_air + 0.3 * radiance(310.0);
  EXPECT_NEAR(kelvin_of(count_of(seen), kPlanck, object), 330.0, 1e-9);
}

TEST(Radiometry, TheTableIsInStepsOf10mK) {
  const auto table = kelvin_table(kPlanck, {});
  ASSERT_EQ(table.size(), 65536U);
  const auto count = static_cast<std::size_t>(std::lround(count_of(radiance(300.0))));
  EXPECT_NEAR(table[count], 30000.0, 5.0) << "a count is some 6 mK there";
  for (std::size_t i = 1; i < table.size(); ++i) ASSERT_GE(table[i], table[i - 1]);
  EXPECT_EQ(table[0], 0U);
}

}  // namespace
}  // namespace bolo::genicam::radiometry_test
