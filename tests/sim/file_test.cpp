// Files: trajectories and paths along them, pictures of every format, written captures.
#include <png.h>
#include <turbojpeg.h>

#include "src/sim/path.hpp"
#include "tests/capture/hdf5_edit.hpp"
#include "tests/sim/support.hpp"

namespace bolo::sim::file_test {

using ReadImage = ScratchTest;
using WriteCapture = ScratchTest;

TEST(SteadyPan, MovesWhatIsSeenAlongX) {
  const Path pan = steady_pan(300.0);
  EXPECT_DOUBLE_EQ(pan.at(0.5).x_px, -150.0);  // the view moves in the opposite direction
  EXPECT_DOUBLE_EQ(pan.at(-0.1).x_px, 30.0);
  EXPECT_DOUBLE_EQ(pan.at(7.0).x_px, -2100.0);
  EXPECT_EQ(pan.at(3.0).y_px, 0.0);
}

TEST(Path, GoesStraightBetweenAndBeyondItsPoints) {
  const Path path({{0, 0, 10}, {1, 4, 10}, {3, 4, 30}});
  EXPECT_DOUBLE_EQ(path.at(0.25).x_px, 1.0);
  EXPECT_DOUBLE_EQ(path.at(2.0).y_px, 20.0);
  EXPECT_DOUBLE_EQ(path.at(-1.0).x_px, -4.0);
  EXPECT_DOUBLE_EQ(path.at(4.0).y_px, 40.0);
}

TEST(Path, BoundsHoldTheBendsBetween) {
  const Path path({{0, 0, 0}, {1, 9, -2}, {2, 1, 5}});
  const auto bounds = path.bounds(0.0, 2.0);
  EXPECT_EQ(bounds.low.x_px, 0.0);
  EXPECT_EQ(bounds.high.x_px, 9.0);
  EXPECT_EQ(bounds.low.y_px, -2.0);
  EXPECT_EQ(bounds.high.y_px, 5.0);
}

TEST(Path, AStillCameraNeedsOneStep) {
  std::vector<double> times;
  steady_pan(0.0).crossings(0.0, 0.005, times);
  EXPECT_EQ(times, std::vector<double>{0.005});
}

std::string refusal(const std::string& content) {
  const Scratch scratch;
  const auto points = read_trajectory(scratch.text("t.csv", content));
  if (points) return "accepted";
  EXPECT_EQ(points.error().exit_code(), 2);
  const std::string& message = points.error().message;
  return message.substr(message.find("t.csv"));
}

TEST(ReadTrajectory, TakesCommentsBlankLinesAndCarriageReturns) {
  const Scratch scratch;
  const auto points =
      must(read_trajectory(scratch.text("t.csv", "# hand\nt_s,x_px,y_px\r\n0, 1.5,-2\r\n\n# more\n0.1,2e0,3\n")));
  ASSERT_EQ(points->size(), 2U);
  EXPECT_EQ((*points)[0].y_px, -2.0);
  EXPECT_EQ((*points)[1].t_s, 0.1);
  EXPECT_EQ((*points)[1].x_px, 2.0);
}

TEST(ReadTrajectory, RefusesBadFilesByLine) {
  const std::string head = "t_s,x_px,y_px\n";
  const std::string numbers = "expected three finite numbers 't_s,x_px,y_px'";
  EXPECT_EQ(refusal("x,y,t\n0,0,0\n"), "t.csv:1: the first line must be 't_s,x_px,y_px'");
  EXPECT_EQ(refusal(head + "0,0,0\n1,2\n"), "t.csv:3: " + numbers);
  EXPECT_EQ(refusal(head + "0,0,0\n1,2,3,4\n"), "t.csv:3: " + numbers);
  EXPECT_EQ(refusal(head + "0,0,0\n\n1,2,x\n"), "t.csv:4: " + numbers);
  EXPECT_EQ(refusal(head + "0,nan,0\n"), "t.csv:2: " + numbers);
  EXPECT_EQ(refusal(head + "0,1e999,0\n"), "t.csv:2: " + numbers);
  EXPECT_EQ(refusal(head + "0,0,0\n1,0,0\n1,0,0\n"), "t.csv:4: t_s must rise from line to line");
  EXPECT_EQ(refusal(head + "0,0,0\n"), "t.csv: a trajectory needs at least two points");
  EXPECT_EQ(refusal(""), "t.csv: a trajectory needs at least two points");
  EXPECT_FALSE(read_trajectory("/nonexistent/t.csv"));
}

TEST(FollowTrajectory, PassesThroughThePointsAndStartsAtZero) {
  const std::vector<PathPoint> points{{0, 5, 1}, {1, 8, 3}, {2, 4, 2}, {3, 4, -1}};
  const auto path = must(follow_trajectory(points, {2.0, 1.0, -1.0, 2.0, 0.125}));
  EXPECT_NEAR(path->at(0.0).x_px, 0.0, 1e-12);
  EXPECT_NEAR(path->at(-1.0).x_px, 2.0 * (5 - 8), 1e-12);
  EXPECT_NEAR(path->at(1.0).y_px, 2.0 * (2 - 3), 1e-12);
  EXPECT_NEAR(path->at(2.0).y_px, 2.0 * (-1 - 3), 1e-12);
}

// The natural spline through 0, 1, 0 at t = 0, 1, 2 is x = 1.5 t - 0.5 t^3 up to t = 1.
TEST(FollowTrajectory, IsTheNaturalCubicSpline) {
  const std::vector<PathPoint> points{{0, 0, 0}, {1, 1, 0}, {2, 0, 0}};
  const auto path = must(follow_trajectory(points, {1.0, 0.0, -0.5, 2.0, 0.25}));
  EXPECT_NEAR(path->at(0.5).x_px, 1.5 * 0.5 - 0.5 * 0.125, 1e-12);
  EXPECT_NEAR(path->at(1.5).x_px, 1.5 * 0.5 - 0.5 * 0.125, 1e-12);
  EXPECT_NEAR(path->at(-0.5).x_px, -0.75, 1e-12);  // linear before the first point
}

TEST(FollowTrajectory, RefusesACaptureThatOutlivesIt) {
  const std::vector<PathPoint> points{{0, 0, 0}, {1, 1, 0}};
  EXPECT_TRUE(follow_trajectory(points, {1.0, 0.5, -0.1, 0.5, 0.01}));
  EXPECT_FALSE(follow_trajectory(points, {1.0, 0.5, -0.1, 0.6, 0.01}));
  EXPECT_FALSE(follow_trajectory(points, {1.0, -0.1, -0.1, 0.5, 0.01}));
}

// --- Pictures: every supported format, and refusal of others.

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

TEST_F(ReadImage, EightBitGreyIsLinearFromColdToHot) {
  write_png(scratch_ / "a.png", 3, 2, 8, PNG_COLOR_TYPE_GRAY, {0, 51, 255, 102, 1, 254});
  expect_near(read(scratch_ / "a.png"), {285.0F, 290.0F, 310.0F, 295.0F, 285.098F, 309.902F}, 1e-3F);
  expect_near(read(scratch_ / "a.png", {0.0, 255.0}), {0, 51, 255, 102, 1, 254}, 1e-3F);
}

TEST_F(ReadImage, SixteenBitGreyKeepsItsDepth) {
  write_png(scratch_ / "a.png", 3, 1, 16, PNG_COLOR_TYPE_GRAY, {0x00, 0x01, 0x80, 0x00, 0xff, 0xff});
  expect_near(read(scratch_ / "a.png", {0.0, 65535.0}), {1, 32768, 65535}, 0.01F);
}

TEST_F(ReadImage, ColourBecomesGrey) {
  write_png(scratch_ / "a.png", 2, 1, 8, PNG_COLOR_TYPE_RGB, {100, 100, 100, 0, 255, 0});
  const auto rgb = read(scratch_ / "a.png", {1.0, 256.0});
  EXPECT_NEAR(rgb[0], 101.0F, 0.05F);
  EXPECT_NEAR(rgb[1], 1.0F + 0.715F * 255.0F, 1.0F);
  write_png(scratch_ / "p.png", 8, 1, 1, PNG_COLOR_TYPE_PALETTE, {0b10110001});
  expect_near(read(scratch_ / "p.png", {1.0, 2.0}), {2, 1, 2, 2, 1, 1, 1, 2}, 1e-4F);
  write_png(scratch_ / "t.png", 2, 1, 8, PNG_COLOR_TYPE_GRAY_ALPHA, {10, 0, 20, 255});
  expect_near(read(scratch_ / "t.png", {0.0, 255.0}), {10, 20}, 1e-3F);
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

TEST_F(ReadImage, Jpeg) {
  const auto image = must(read_image(scratch_.text("a.jpg", jpeg(24, 16)), {0.0, 255.0}));
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

TEST_F(ReadImage, Hdf5IsInKelvinAlready) {
  write_still(scratch_ / "a.h5", {300.5, 301, 302, 303, 304, 305});
  const auto image = must(read_image(scratch_ / "a.h5", {}));
  EXPECT_EQ(image->width, 3);
  EXPECT_EQ(image->kelvin, (std::vector<float>{300.5F, 301, 302, 303, 304, 305}));
  EXPECT_FALSE(*has_grey_levels(scratch_ / "a.h5"));
}

TEST_F(ReadImage, RefusesValuesThatAreNoTemperatures) {
  for (const double wrong : {std::nan(""), -1.0, HUGE_VAL}) {
    write_still(scratch_ / "a.h5", {300, 301, wrong, 303});
    expect_refused(read_image(scratch_ / "a.h5", {}), {"a.h5: "});
  }
}

TEST_F(ReadImage, RefusesWhatIsDamagedOrNoPicture) {
  write_png(scratch_ / "a.png", 64, 64, 8, PNG_COLOR_TYPE_GRAY, std::vector<std::uint8_t>(4096, 7));
  std::ifstream in(scratch_ / "a.png", std::ios::binary);
  const std::string png{std::istreambuf_iterator<char>(in), {}};
  std::string flipped = png;
  flipped[png.size() - 20] = static_cast<char>(flipped[png.size() - 20] ^ 0x55);
  const std::vector<std::string> contents{"", "no picture", png.substr(0, 8), flipped, png.substr(0, 50),
                                          // other formats
                                          jpeg(64, 64).substr(0, 300), "\xff\xd8\xff", "\x89HDF\r\n\x1a\n garbage"};
  for (const std::string& content : contents) {
    expect_refused(read_image(scratch_.text("x", content), {}), {"x: "});
  }
  EXPECT_FALSE(read_image("/nonexistent/a.png", {}));
  EXPECT_FALSE(read_image("/", {}));
}

// Real pictures and real motion.
TEST_F(ReadImage, RealScenesAreRead) {
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

// --- Files of write_capture(), read back through CaptureReader.

constexpr Geometry kSmall{24, 10};

// Simulates `frames` frames of a small camera to a file and opens it.
Result<capture::CaptureReader> record(const std::filesystem::path& file, std::unique_ptr<const Field> field,
                                      std::size_t frames = 6, bool truth = true) {
  CameraSettings camera;
  camera.geometry = kSmall;
  auto simulator = Simulator::create(camera, std::move(field));
  if (!simulator) return tl::unexpected(simulator.error());
  const Status written =
      write_capture(**simulator, file, {frames, truth, truth ? 1 : 0}, [](std::size_t) { return true; });
  if (!written) return tl::unexpected(written.error());
  return capture::CaptureReader::open(file);
}

Result<capture::Stimulus> stimulus_of(std::unique_ptr<const Field> field) {
  const Scratch scratch;
  const auto reader = record(scratch / "a.h5", std::move(field));
  if (!reader) return tl::unexpected(reader.error());
  return reader->stimulus();
}

TEST_F(WriteCapture, FramesTimesAndTruth) {
  const auto reader = must(record(scratch_ / "a.h5", make_uniform(301.25)));
  EXPECT_EQ(reader->info().format.geometry, kSmall);
  EXPECT_EQ(reader->info().format.scale, (LinearScale{Unit::kKelvin, 0.01, 0.0}));
  EXPECT_EQ(reader->info().format.frame_period_s, 0.005);
  EXPECT_EQ(reader->info().camera_model, "Bolo simulator");
  ASSERT_EQ(reader->t().size(), 6U);
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_EQ(reader->t()[k], static_cast<double>(k) / 200.0);
    EXPECT_EQ(reader->frame_id()[k], k);
  }
  std::vector<float> truth(kSmall.pixels());
  ASSERT_TRUE(reader->read_truth(5, truth.data()));
  EXPECT_EQ(truth, std::vector<float>(kSmall.pixels(), 301.25F));
  std::vector<std::uint16_t> plane(kSmall.pixels());
  ASSERT_TRUE(reader->read_frame(5, plane.data()));
  for (const std::uint16_t value : plane) EXPECT_NEAR(0.01 * value, 301.25, 0.2);
}

TEST_F(WriteCapture, TruthCanBeLeftOut) {
  const auto reader = must(record(scratch_ / "a.h5", make_uniform(300.0), 2, false));
  EXPECT_FALSE(reader->info().has_truth);
}

TEST_F(WriteCapture, TheStimulusIsWhatWasSimulated) {
  const capture::Uniform uniform{301.25};
  const capture::Chopper chopper{295, {0.01, 0.02}, {0.013, 0.025}, {305, 320}};
  const capture::BarTarget bars{285, 310, 12, 5, 0.25, -70};
  EXPECT_EQ(stimulus_of(make_uniform(301.25)).value(), capture::Stimulus(uniform));
  EXPECT_EQ(stimulus_of(make_chopper(chopper)).value(), capture::Stimulus(chopper));
  EXPECT_EQ(stimulus_of(make_bars(bars)).value(), capture::Stimulus(bars));
}

// The stored still and path reproduce the stored truth within float rounding.
TEST_F(WriteCapture, SceneStimulusGivesTheTruth) {
  const auto street = make_street(kSmall, 8);
  auto field = pan_over(*street, steady_pan(300), {0, 0}, kSmall, -0.154, 0.03);
  ASSERT_TRUE(field);
  const auto reader = record(scratch_ / "a.h5", std::move(*field));
  ASSERT_TRUE(reader);
  const auto stimulus = must(reader->stimulus());
  const auto& scene = std::get<capture::SceneStimulus>(*stimulus);
  EXPECT_LE(scene.t_s.front(), -0.15);  // the camera was moving before the first frame
  EXPECT_GE(scene.t_s.back(), 0.025);
  const double speed = (scene.x_px.back() - scene.x_px.front()) / (scene.t_s.back() - scene.t_s.front());
  EXPECT_NEAR(speed, -300.0, 1e-6);
  std::vector<float> truth(kSmall.pixels());
  for (std::size_t k = 0; k < 6; ++k) {
    ASSERT_TRUE(reader->read_truth(k, truth.data()));
    const double x0 = scene.x_px.front() + speed * (0.005 * static_cast<double>(k) - scene.t_s.front());
    for (std::size_t x = 0; x < 24; ++x) {
      const double at = x0 + static_cast<double>(x);
      const auto i = static_cast<std::size_t>(at);
      const double part = at - static_cast<double>(i);
      const std::size_t row = 4 * static_cast<std::size_t>(scene.image_width);
      const double seen = (1 - part) * static_cast<double>(scene.image_k[row + i]) +
                          part * static_cast<double>(scene.image_k[row + i + 1]);
      EXPECT_NEAR(truth[4 * 24 + x], seen, 1e-3) << "frame " << k << " x " << x;
    }
  }
}

TEST_F(WriteCapture, StopsInGoodOrderWhenAsked) {
  CameraSettings camera;
  camera.geometry = kSmall;
  auto simulator = must(Simulator::create(camera, make_uniform(300.0)));
  std::vector<std::size_t> calls;
  must(write_capture(**simulator, scratch_ / "a.h5", {50, true, 0}, [&calls](std::size_t done) {
    calls.push_back(done);
    return done < 3;
  }));
  EXPECT_EQ(calls, (std::vector<std::size_t>{1, 2, 3}));
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "a.h5"));
  const auto reader = must(capture::CaptureReader::open(scratch_ / "a.h5.part"));
  EXPECT_EQ(reader->t().size(), 3U);
}

}  // namespace bolo::sim::file_test
