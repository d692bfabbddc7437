// What the verbs draw, of figures made up: well-formed, without numbers that are none, no word on another one.
#include "tests/report/markup.hpp"
#include "tools/bolo/pulse_plots.hpp"
#include "tools/demo/live_check.hpp"
#include "tools/lab/detect/table.hpp"
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

TEST(Figures, OfFidelityHaveLatencyAndAPanelForEachLookAhead) {
  Json table;
  for (const int lookahead : {0, 1}) {
    for (const double noise : {0.03, 0.5}) {
      Json cell{{"scene", "street"}, {"motion", "300 px/s"}, {"noise_k", noise}, {"lookahead", lookahead}};
      double rmse_k = 0.3;
      for (const fidelity::Column& column : fidelity::kColumns) {
        cell["columns"][column.name]["rmse_k"] = rmse_k += 0.2;
      }
      cell["columns"]["unsharp"] = {{"skipped", "not here"}};
      table["cells"].push_back(cell);
    }
  }
  Json curves{{"scene", "street"}, {"motion", "300 px/s"}, {"noise_k", 0.03}, {"blurred_rmse_k", 1.9}};
  curves["lookaheads"] = {0, 1, 2};
  for (const char* column : fidelity::kLiveColumns) curves[column] = {1.1, 0.7, 0.65};
  curves["inverse"] = {NAN, NAN, NAN};
  table["latency"] = {curves, curves};
  const plot::Sheet sheet = fidelity::sheet_of(table);
  expect_good(sheet);
  EXPECT_EQ(plots_of(sheet), 2U + 4U);
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

// Two stills, one of them labelled, looked at twice by two detectors; in the blurred column everything is missed but in
// the second look, in the others found.
detect::Found found_boxes(const detect::Options& options) {
  using detect::Detection;
  detect::Found found;
  found.stills = {{"a.png", {64, 48}, true, {}}, {"b.png", {64, 48}, false, {}}};
  found.columns = detect::own_columns();
  found.knows = {{true, true}, {true, false}};
  for (std::size_t i = 0; i < 4; ++i) {
    detect::Look& look = found.looks.emplace_back();
    look.view.still = i % 2;
    look.speed_px_s = 100.0 * static_cast<double>(i + 1);
    if (i % 2 == 0) look.labels = {{0, {4, 4, 20, 20}}, {1, {30, 4, 20, 20}}};
    const std::vector<Detection> sure{{0, 0.9, {4, 4, 20, 20}}, {1, 0.8, {30, 4, 20, 20}}};
    look.found.assign(options.detectors.size(), {found.columns.size(), sure});
    look.found[1].assign(found.columns.size(), {sure.front()});
    if (i < 2) {
      for (auto& columns : look.found) columns[detect::kBlurredColumn].clear();
    }
  }
  const detect::Levels grey(options.picture.pixels(), 90.0F);
  found.exhibits = {{0, std::vector<detect::Levels>(found.columns.size(), grey)}};
  return found;
}

TEST(Figures, OfDetectorsShowWhatEachColumnShows) {
  detect::Options options;
  options.picture = {64, 48};
  options.classes = {{"person", 1}, {"car", 3}};
  options.trajectories = {"hand.csv"};
  options.detectors.resize(2);
  options.detectors[0].name = "first";
  options.detectors[1].name = "second";
  options.resamples = 20;
  const detect::Found found = found_boxes(options);
  const Json table = table_of(found, options);
  const Json& rows = table.at("rows");
  ASSERT_EQ(rows.size(), 6U);  // of labels and of own boxes: each detector, and their mean
  EXPECT_EQ(table.at("motions")[0].at("speed_px_s").at("p50"), 200.0);
  for (const Json& row : rows) {
    SCOPED_TRACE(row.dump());
    EXPECT_EQ(row.at("looks"), 2);
    EXPECT_EQ(row.at("stills"), 1);
    const auto figure = [&](const char* column, const char* key) {
      return row.at("columns").at(column).at(key).get<double>();
    };
    EXPECT_NEAR(figure("sharp", "ap"), 100.0, 1e-9);
    // One of two pictures: the recalls 0 to 0.5 of 101.
    EXPECT_NEAR(figure("blurred", "ap"), 100.0 * 51.0 / 101.0, 1e-9);
    EXPECT_NEAR(figure("auto", "delta_ap"), 100.0 * 50.0 / 101.0, 1e-9);
    EXPECT_NEAR(figure("auto", "recovered"), 1.0, 1e-9);
    EXPECT_NEAR(row.at("bolo_over_best_baseline").at("delta_ap").get<double>(), 0.0, 1e-9);
  }
  EXPECT_EQ(rows[0].at("objects"), 4.0);
  EXPECT_EQ(rows[1].at("objects"), 2.0);  // it does not know cars
  EXPECT_TRUE(rows[2].at("detector").is_null());
  EXPECT_EQ(rows[0].at("truth"), "labels");
  EXPECT_EQ(rows[3].at("truth"), "own_boxes");
  const plot::Sheet sheet = sheet_of(table, found, options);
  expect_good(sheet);
  EXPECT_EQ(plots_of(sheet), found.columns.size());
  EXPECT_EQ(sheet.tables.size(), 2U);
}

}  // namespace bolo::tools::figures_test
