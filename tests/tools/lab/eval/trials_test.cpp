// Computations behind `bolo-lab eval pulses` and `bolo-lab eval pixel`, and the display of their rows.
#include "tools/lab/eval/trials.hpp"
#include "src/deblur/solver.hpp"
#include "tests/test.hpp"
#include "tools/lab/common.hpp"

namespace bolo::tools::trials_test {

TEST(ReportText, ShowsListsAsTablesAndWhatIsTooWideLineByLine) {
  const Json row{{"name", "a"}, {"in", {{"share", 0.25}}}, {"whole", 12345678}, {"list", {"x", "y"}}, {"none", NAN}};
  EXPECT_EQ(report_text({{"seed", 1}, {"rows", {row, {{"name", "bcd"}, {"more", true}}}}}),
            "seed 1\n"
            "rows\n"
            "  name  in/share     whole  list/0  list/1  none  more\n"
            "  a         0.25  12345678       x       y     -\n"
            "  bcd                                              yes\n");
  const std::string wide(240, 'w');
  const Json one{{"wide", wide}, {"table", {{"l", {{"n", 1}}}}}};
  EXPECT_EQ(report_text({{"of", {{"k", one}}}}),
            "of\n"
            "  k: wide " +
                wide +
                "\n"
                "  table\n"
                "       n\n"
                "    l  1\n");
}

// With almost no prior, both fit an input that is constant within each frame, and recover it.
TEST(PixelTrial, BothFindAnInputThatJumpsAtFramesOnly) {
  const PixelTrial trial{.levels = 4, .lambda = 1e-7, .switch_s = {0.010, 0.030, 0.045, 0.060}};
  const auto samples = sample_pixel(trial);
  EXPECT_LT(rmse(least_squares(trial, samples), truth_of(trial)), 1e-6);
  EXPECT_LT(rmse(quadratic_programme(trial, samples), truth_of(trial)), 1e-3);
}

// The window's last bin is what the project's reference solver publishes.
TEST(PixelTrial, TheQuadraticProgrammeIsTheSolvers) {
  const PixelTrial trial;
  std::vector<double> samples = sample_pixel(trial);
  for (std::size_t k = 0; k < samples.size(); ++k) samples[k] += 0.4 * std::sin(5.0 * static_cast<double>(k * k));
  const deblur::Settings settings{.method = deblur::Method::kExact, .lambda = trial.lambda};
  const auto solver = deblur::Solver::create(
      settings, {{1, 1}, PixelType::kFloat32, {Unit::kKelvin, 1.0, 0.0}, trial.period_s, 1}, PixelType::kFloat32);
  ASSERT_TRUE(solver) << solver.error().message;
  std::vector<float> values(samples.begin(), samples.end());
  std::vector<double> rounded(values.begin(), values.end());
  std::vector<const void*> planes;
  for (const float& v : values) planes.push_back(&v);
  const deblur::WindowView window{planes, 16};
  (*solver)->prepare(window);
  float last = 0.0F;
  (*solver)->solve(window, {0, 0, 1, 1}, &last);
  EXPECT_NEAR(static_cast<double>(last), quadratic_programme(trial, rounded).back(), 1e-3);
}

}  // namespace bolo::tools::trials_test
