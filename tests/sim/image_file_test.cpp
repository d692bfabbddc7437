// Pictures of every kind that is read, and the refusal of others.
#include <png.h>
#include <turbojpeg.h>

#include "tests/capture/hdf5_edit.hpp"
#include "tests/sim/support.hpp"

namespace bolo::sim::image_file_test {

using testing::Scratch;

void write_png(const std::filesystem::path& file, int width, int height, int depth, int colour,
               const std::vector<std::uint8_t>& rows) {
  std::FILE* out = std::fopen(file.c_str(), "wb");
  ASSERT_NE(out, nullptr);
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, out);
  png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), depth, colour,
               PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  if (colour == PNG_COLOR_TYPE_PALETTE) {
    const png_color palette[2] = {{0, 0, 0}, {255, 255, 255}};
    png_set_PLTE(png, info, palette, 2);
  }
  png_write_info(png, info);
  const std::size_t row_bytes = rows.size() / static_cast<std::size_t>(height);
  for (int y = 0; y < height; ++y) png_write_row(png, rows.data() + static_cast<std::size_t>(y) * row_bytes);
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  std::fclose(out);
}

std::vector<float> read(const std::filesystem::path& file, const GreySpan& span = {}) {
  return must(read_image(file, span))->kelvin;
}

void expect_near(const std::vector<float>& values, const std::vector<float>& expected, float tolerance) {
  ASSERT_EQ(values.size(), expected.size());
  for (std::size_t i = 0; i < values.size(); ++i) EXPECT_NEAR(values[i], expected[i], tolerance) << i;
}

TEST(ReadImage, EightBitGreyIsLinearFromColdToHot) {
  const Scratch scratch;
  write_png(scratch / "a.png", 3, 2, 8, PNG_COLOR_TYPE_GRAY, {0, 51, 255, 102, 1, 254});
  expect_near(read(scratch / "a.png"), {285.0F, 290.0F, 310.0F, 295.0F, 285.098F, 309.902F}, 1e-3F);
  expect_near(read(scratch / "a.png", {0.0, 255.0}), {0, 51, 255, 102, 1, 254}, 1e-3F);
}

TEST(ReadImage, SixteenBitGreyKeepsItsDepth) {
  const Scratch scratch;
  write_png(scratch / "a.png", 3, 1, 16, PNG_COLOR_TYPE_GRAY, {0x00, 0x01, 0x80, 0x00, 0xff, 0xff});
  expect_near(read(scratch / "a.png", {0.0, 65535.0}), {1, 32768, 65535}, 0.01F);
}

TEST(ReadImage, ColourBecomesGrey) {
  const Scratch scratch;
  write_png(scratch / "a.png", 2, 1, 8, PNG_COLOR_TYPE_RGB, {100, 100, 100, 0, 255, 0});
  const auto rgb = read(scratch / "a.png", {1.0, 256.0});
  EXPECT_NEAR(rgb[0], 101.0F, 0.05F);
  EXPECT_NEAR(rgb[1], 1.0F + 0.715F * 255.0F, 1.0F);
  write_png(scratch / "p.png", 8, 1, 1, PNG_COLOR_TYPE_PALETTE, {0b10110001});
  expect_near(read(scratch / "p.png", {1.0, 2.0}), {2, 1, 2, 2, 1, 1, 1, 2}, 1e-4F);
  write_png(scratch / "t.png", 2, 1, 8, PNG_COLOR_TYPE_GRAY_ALPHA, {10, 0, 20, 255});
  expect_near(read(scratch / "t.png", {0.0, 255.0}), {10, 20}, 1e-3F);
}

std::string jpeg(int width, int height) {
  std::vector<unsigned char> grey;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) grey.push_back(static_cast<unsigned char>(40 + 5 * x + y));
  }
  const tjhandle encoder = tjInitCompress();
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  EXPECT_EQ(tjCompress2(encoder, grey.data(), width, 0, height, TJPF_GRAY, &bytes, &size, TJSAMP_GRAY, 98, 0), 0);
  std::string result(reinterpret_cast<char*>(bytes), size);
  tjFree(bytes);
  tjDestroy(encoder);
  return result;
}

TEST(ReadImage, Jpeg) {
  const Scratch scratch;
  const auto image = must(read_image(scratch.text("a.jpg", jpeg(24, 16)), {0.0, 255.0}));
  EXPECT_EQ(image->width, 24);
  EXPECT_EQ(image->height, 16);
  EXPECT_NEAR(image->kelvin[0], 40.0F, 2.0F);
  EXPECT_NEAR(image->kelvin[16 * 24 - 1], 170.0F, 2.0F);
}

void write_still(const std::filesystem::path& file, const std::vector<double>& kelvin) {
  H5Fclose(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  capture::testing::edit(file,
                         capture::testing::with_dataset("/image_k", H5T_IEEE_F32LE, {2, kelvin.size() / 2}, kelvin));
}

TEST(ReadImage, Hdf5IsInKelvinAlready) {
  const Scratch scratch;
  write_still(scratch / "a.h5", {300.5, 301, 302, 303, 304, 305});
  const auto image = must(read_image(scratch / "a.h5", {}));
  EXPECT_EQ(image->width, 3);
  EXPECT_EQ(image->kelvin, (std::vector<float>{300.5F, 301, 302, 303, 304, 305}));
  EXPECT_FALSE(*has_grey_levels(scratch / "a.h5"));
}

TEST(ReadImage, RefusesValuesThatAreNoTemperatures) {
  const Scratch scratch;
  for (const double wrong : {std::nan(""), -1.0, HUGE_VAL}) {
    write_still(scratch / "a.h5", {300, 301, wrong, 303});
    expect_refused(read_image(scratch / "a.h5", {}), {"a.h5: "});
  }
}

TEST(ReadImage, RefusesWhatIsDamagedOrNoPicture) {
  const Scratch scratch;
  write_png(scratch / "a.png", 64, 64, 8, PNG_COLOR_TYPE_GRAY, std::vector<std::uint8_t>(4096, 7));
  std::ifstream in(scratch / "a.png", std::ios::binary);
  const std::string png{std::istreambuf_iterator<char>(in), {}};
  std::string flipped = png;
  flipped[png.size() - 20] = static_cast<char>(flipped[png.size() - 20] ^ 0x55);
  const std::vector<std::string> contents{"", "no picture", png.substr(0, 8), flipped, png.substr(0, 50),
                                          // of other kinds
                                          jpeg(64, 64).substr(0, 300), "\xff\xd8\xff", "\x89HDF\r\n\x1a\n garbage"};
  for (const std::string& content : contents) {
    expect_refused(read_image(scratch.text("x", content), {}), {"x: "});
  }
  EXPECT_FALSE(read_image("/nonexistent/a.png", {}));
  EXPECT_FALSE(read_image("/", {}));
}

// Real pictures and real motion.
TEST(ReadImage, RealScenesAreRead) {
  const char* const folder = std::getenv("BOLO_TEST_DATA");
  if (folder == nullptr) GTEST_SKIP() << "BOLO_TEST_DATA is not set: real scenes are not tried";
  const std::filesystem::path data = folder;
  for (const char* const name : {"scenes/radiometric_02.h5", "street/FLIR_05573.png"}) {
    const auto image = must(read_image(data / name, {}));
    EXPECT_GT(image->width, 100);
  }
  const auto points = must(read_trajectory(data / "trajectories/fast_indoor.csv"));
  const auto path = must(follow_trajectory(*points, {1.0, 20.0, -0.2, 2.0, 0.000625}));
}

}  // namespace bolo::sim::image_file_test
