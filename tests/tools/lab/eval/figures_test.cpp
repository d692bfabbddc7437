// The verbs' plots of invented figures: well-formed, no NaN, no overlapping words.
#include "tests/report/markup.hpp"
#include "tools/bolo/pulse_plots.hpp"
#include "tools/demo/live_check.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::figures_test {

std::size_t plots_of(const plot::Sheet& sheet) {
  std::size_t plots = 0;
  for (const auto& row : sheet.rows) {
    for (const plot::Plot& one : row) {
      EXPECT_TRUE(plot::has_content(one)) << one.title;
      ++plots;
    }
  }
  return plots;
}

void expect_good(const plot::Sheet& sheet) {
  const std::string svg = plot::to_svg(sheet.rows, sheet.title);
  const auto elements = plot::test::elements_of(svg);
  EXPECT_FALSE(elements.empty()) << sheet.title;
  const auto found = plot::test::overlaps(plot::test::text_boxes(elements));
  EXPECT_TRUE(found.empty()) << sheet.title << ": " << (found.empty() ? "" : found.front());
  for (const auto& element : elements) {
    for (const auto& [key, value] : element.attributes) {
      if (key == "href" || key == "aria-label") continue;
      EXPECT_EQ(value.find("nan"), std::string::npos) << element.name << ' ' << key << ' ' << value;
      EXPECT_EQ(value.find("inf"), std::string::npos) << element.name << ' ' << key << ' ' << value;
    }
  }
}

TEST(Figures, OfPulsesHaveAFit) {
  diagnose::PulseFit fit;
  fit.noise_k = 0.03;
  fit.switches_s = {0.1, 0.2, 0.9};
  for (int i = 0; i < 400; ++i) {
    fit.trace.t_s.push_back(0.005 * i);
    fit.trace.measured_k.push_back(300.0 + i % 20);
    fit.trace.simulated_k.push_back(i % 50 == 0 ? NAN : 300.0 + i % 20);
    fit.trace.fine_t_s.push_back(0.005 * i);
    fit.trace.fine_k.push_back(300.0 + i % 20);
  }
  plot::Sheet sheet{.title = "The time constant from pulses"};
  for (const plot::Plot& part : pulse_plots(fit, fit.noise_k)) sheet.rows.push_back({part});
  expect_good(sheet);
  EXPECT_EQ(plots_of(sheet), 3U);
  for (std::size_t k = 100; k < 400; ++k) fit.trace.measured_k[k] += 15.0;
  EXPECT_LT(pulse_plots(fit, fit.noise_k)[1].y.high, 325.0) << "of what is magnified only";
  EXPECT_TRUE(pulse_plots({}, 0.03).empty()) << "a fit without a pixel";
}

TEST(Figures, OfFidelityHaveARowForEachMotionAndAPanelForEachNoise) {
  Json cells = Json::array();
  for (const char* motion : {"300 px/s", "hand"}) {
    for (const double noise : {0.03, 0.5}) {
      for (const int lookahead : {0, 1, 2}) {
        Json cell{{"scene", "a/street.png"}, {"motion", motion}, {"noise_k", noise}, {"lookahead", lookahead}};
        double rmse_k = 2.0 - 0.2 * lookahead;
        for (const fidelity::Column& column : fidelity::kColumns) {
          cell["columns"][column.name]["rmse_k"] = rmse_k -= 0.12;
        }
        if (lookahead > 1) cell["columns"]["motion"] = {{"skipped", "no more than 1"}};
        cells.push_back(cell);
      }
    }
  }
  const plot::Sheet sheet = fidelity::sheet_of(cells);
  expect_good(sheet);
  EXPECT_EQ(sheet.rows.size(), 2U);
  EXPECT_EQ(plots_of(sheet), 4U);
}

TEST(Figures, OfTheLiveStreamShowTheFrameWithMostToSeeOrTheOneAskedFor) {
  const Geometry g{160, 80};
  bolo_shm_header header{};
  header.width = 160;
  header.height = 80;
  header.scale = 0.01;
  header.offset = 100.0;
  shm::ReadFrame frame;
  frame.raw.assign(g.pixels(), 20000);
  frame.deblurred.assign(g.pixels(), 20100);
  const std::vector<float> flat(g.pixels(), 300.0F);
  std::vector<float> edges = flat;
  for (std::size_t i = 0; i < edges.size(); i += 7) edges[i] = 310.0F;
  FrameChoice most;
  FrameChoice third(2);
  for (const std::size_t index : {0U, 1U, 2U}) {
    most.take(header, frame, index == 1 ? edges : flat, index);
    third.take(header, frame, index == 1 ? edges : flat, index);
    EXPECT_EQ(third.waits(), index < 2);
  }
  EXPECT_EQ(third.shown().index, 2U);
  EXPECT_EQ(most.shown().index, 1U);
  EXPECT_EQ(most.shown().truth, edges);
  EXPECT_FLOAT_EQ(most.shown().blurred[0], 300.0F);
  const plot::Sheet sheet =
      sheet_of(std::array{LiveResult{&most.shown(), {"admm", 1.7, 0.9, 0.005, {2.0, 3.0, 2.5}}},
                          LiveResult{&most.shown(), {"motion", 1.7, 0.2, 0.005, {2.0, 3.0, 2.5}}}});
  expect_good(sheet);
  EXPECT_EQ(plots_of(sheet), 4U + 4U + 3U) << "blurred, admm, motion, truth, large and close";
}

}  // namespace bolo::tools::figures_test
