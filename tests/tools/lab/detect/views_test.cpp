// Looks at a still: a bright box in the picture is where the moved label says.
#include "tools/lab/detect/table.hpp"

#include <png.h>

#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tools/lab/detect/boxes.hpp"

namespace bolo::tools::detect::views_test {

constexpr Geometry kStill{160, 128};
constexpr Geometry kPicture{96, 80};
constexpr Box kBright{60, 50, 32, 20};

// Grey, with a bright box, and a label on it.
std::filesystem::path make_still(const Scratch& folder) {
  std::vector<unsigned char> grey(kStill.pixels(), 80);
  for (int y = 50; y < 70; ++y) {
    for (int x = 60; x < 92; ++x) grey[static_cast<std::size_t>(y * kStill.width + x)] = 200;
  }
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(kStill.width);
  image.height = static_cast<png_uint_32>(kStill.height);
  image.format = PNG_FORMAT_GRAY;
  const std::filesystem::path file = folder / "still.png";
  EXPECT_NE(png_image_write_to_file(&image, file.c_str(), 0, grey.data(), 0, nullptr), 0);
  std::ofstream(folder / "still.txt") << "1 0.475 0.46875 0.2 0.15625\n";
  return file;
}

std::filesystem::path make_trajectory(const Scratch& folder) {
  std::string text = "t_s,x_px,y_px\n";
  for (int i = 0; i <= 60; ++i) {
    const double t = i / 30.0;
    text += std::to_string(t) + "," + std::to_string(250.0 * t) + "," + std::to_string(30.0 * std::sin(4.0 * t)) + "\n";
  }
  std::ofstream(folder / "hand.csv") << text;
  return folder / "hand.csv";
}

class Views : public ::testing::Test {
 protected:
  const Scratch scratch_;
  const std::filesystem::path file_ = make_still(scratch_);
  const std::filesystem::path trajectory_ = make_trajectory(scratch_);
  const std::vector<JudgedClass> classes_{{"person", 1}};
};

TEST_F(Views, TheMovedLabelIsWhereTheObjectIsSeen) {
  const auto still = must(read_still(file_, classes_));
  ASSERT_TRUE(still->labelled);
  ASSERT_EQ(still->labels.size(), 1U);
  EXPECT_NEAR(still->labels[0].box.x, kBright.x, 1e-3);
  for (const View& view : {View{0, 0, 0.5, {21.25, 19.75}}, View{0, 0, 0.9, {34.0, 30.75}}}) {
    const auto clean = must(simulate(*still, trajectory_, view, kPicture));
    const auto truth = truth_in_view(still->labels, 1, still->size, kPicture, view.origin);
    ASSERT_EQ(truth.size(), 1U);
    const auto& seen = clean->truth[clean->targets[0]];
    int wrong = 0;
    for (int y = 0; y < kPicture.height; ++y) {
      for (int x = 0; x < kPicture.width; ++x) {
        const bool hot = seen[static_cast<std::size_t>(y * kPicture.width + x)] > 285.0F + 25.0F * 140.0F / 255.0F;
        const bool inside = intersection(truth[0].box, {x + 0.0, y + 0.0, 1.0, 1.0}) > 0.5;
        if (hot != inside) ++wrong;
      }
    }
    EXPECT_LE(wrong, 4);  // corners, where the picture between pixels is not a box
  }
}

TEST_F(Views, ShowEveryColumnAndDeblurringBringsTheEdgeBack) {
  const auto still = read_still(file_, classes_);
  const auto clean = must(simulate(*still, trajectory_, {0, 0, 0.5, {21.25, 19.5}}, kPicture));
  const auto shown = must(shown_columns(fidelity::read_out(*clean, 0.03, 1)));
  ASSERT_EQ(shown->size(), columns().size());
  const auto error = [&](const std::string& name) {
    const auto column = std::ranges::find(columns(), name, &Column::name);
    if (column == columns().end()) return std::nan("");
    return fidelity::rmse({(*shown)[static_cast<std::size_t>(column - columns().begin())]}, {(*shown)[kSharpColumn]});
  };
  EXPECT_EQ(error("sharp"), 0.0);
  EXPECT_GT(error("blurred"), 5.0);
  for (const char* name : {"inverse", "auto", "auto_1", "wiener"}) {
    EXPECT_LT(error(name), 0.8 * error("blurred")) << name;
  }
  EXPECT_LT(error("wiener"), error("wiener_10"));
}

TEST_F(Views, RefuseWhatIsTooShortOrMissing) {
  std::ofstream(scratch_ / "short.csv") << "t_s,x_px,y_px\n0,0,0\n0.1,1,1\n";
  const auto still = read_still(file_, classes_);
  expect_error(plan_views({*still}, {scratch_ / "short.csv"}, {}), {"short.csv: is shorter than"});
  EXPECT_FALSE(read_still(scratch_ / "none.png", classes_));
  std::ofstream(scratch_ / "still.txt") << "1 2 3\n";
  EXPECT_FALSE(read_still(file_, classes_));
}

// Two stills, one of them labelled, looked at twice by two detectors; in the blurred column everything is missed but in
// the second look, in the others found.
Found found_boxes(const Options& options) {
  Found found;
  found.stills = {{"a.png", {64, 48}, true, {}}, {"b.png", {64, 48}, false, {}}};
  found.knows = {{true, true}, {true, false}};
  for (std::size_t i = 0; i < 4; ++i) {
    Observation& observation = found.observations.emplace_back();
    observation.view.still = i % 2;
    observation.speed_px_s = 100.0 * static_cast<double>(i + 1);
    if (i % 2 == 0) observation.labels = {{0, {4, 4, 20, 20}}, {1, {30, 4, 20, 20}}};
    const std::vector<Detection> sure{{0, 0.9, {4, 4, 20, 20}}, {1, 0.8, {30, 4, 20, 20}}};
    observation.found.assign(options.detectors.size(), {columns().size(), sure});
    observation.found[1].assign(columns().size(), {sure.front()});
    if (i < 2) {
      for (auto& of_detector : observation.found) of_detector[kBlurredColumn].clear();
    }
  }
  return found;
}

TEST(DetectTable, HasEachDetectorAndTheirMeanOfLabelsAndOfOwnBoxes) {
  Options options;
  options.picture = {64, 48};
  options.classes = {{"person", 1}, {"car", 3}};
  options.trajectories = {"hand.csv"};
  options.detectors.resize(2);
  options.detectors[0].name = "first";
  options.detectors[1].name = "second";
  options.resamples = 20;
  const Found found = found_boxes(options);
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
  }
  EXPECT_EQ(rows[0].at("objects"), 4.0);
  EXPECT_EQ(rows[1].at("objects"), 2.0);  // it does not know cars
  EXPECT_TRUE(rows[2].at("detector").is_null());
  EXPECT_EQ(rows[0].at("truth"), "labels");
  EXPECT_EQ(rows[3].at("truth"), "own_boxes");
}

}  // namespace bolo::tools::detect::views_test
