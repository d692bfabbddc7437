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

}  // namespace bolo::tools::detect::views_test
