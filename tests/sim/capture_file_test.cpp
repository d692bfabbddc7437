// Files of write_capture(), read back through CaptureReader.
#include "tests/sim/support.hpp"

namespace bolo::sim::capture_file_test {

using testing::Scratch;

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

TEST(WriteCapture, FramesTimesAndTruth) {
  const Scratch scratch;
  const auto reader = must(record(scratch / "a.h5", make_uniform(301.25)));
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

TEST(WriteCapture, TruthCanBeLeftOut) {
  const Scratch scratch;
  const auto reader = must(record(scratch / "a.h5", make_uniform(300.0), 2, false));
  EXPECT_FALSE(reader->info().has_truth);
}

TEST(WriteCapture, TheStimulusIsWhatWasSimulated) {
  const capture::Uniform uniform{301.25};
  const capture::Chopper chopper{295, {0.01, 0.02}, {0.013, 0.025}, {305, 320}};
  const capture::BarTarget bars{285, 310, 12, 5, 0.25, -70};
  EXPECT_EQ(stimulus_of(make_uniform(301.25)).value(), capture::Stimulus(uniform));
  EXPECT_EQ(stimulus_of(make_chopper(chopper)).value(), capture::Stimulus(chopper));
  EXPECT_EQ(stimulus_of(make_bars(bars)).value(), capture::Stimulus(bars));
}

// The stored still and path give the stored truth, to a float's last bits.
TEST(WriteCapture, SceneStimulusGivesTheTruth) {
  const Scratch scratch;
  const auto street = make_street(kSmall, 8);
  auto field = pan_over(*street, steady_pan(300), {0, 0}, kSmall, -0.154, 0.03);
  ASSERT_TRUE(field);
  const auto reader = record(scratch / "a.h5", std::move(*field));
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

TEST(WriteCapture, StopsInGoodOrderWhenAsked) {
  const Scratch scratch;
  CameraSettings camera;
  camera.geometry = kSmall;
  auto simulator = must(Simulator::create(camera, make_uniform(300.0)));
  std::vector<std::size_t> calls;
  must(write_capture(**simulator, scratch / "a.h5", {50, true, 0}, [&calls](std::size_t done) {
    calls.push_back(done);
    return done < 3;
  }));
  EXPECT_EQ(calls, (std::vector<std::size_t>{1, 2, 3}));
  EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
  const auto reader = must(capture::CaptureReader::open(scratch / "a.h5.part"));
  EXPECT_EQ(reader->t().size(), 3U);
}

}  // namespace bolo::sim::capture_file_test
