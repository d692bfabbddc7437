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

// The camera was moving before the first frame.
TEST(WriteCapture, StimulusAndTruthOfASceneAreTheFields) {
  const Scratch scratch;
  const auto pan = [] {
    return pan_over(*make_street(kSmall, 8), steady_pan(300), {0, 0}, kSmall, -0.154, 0.03).value();
  };
  const auto field = pan();
  const auto reader = must(record(scratch / "a.h5", pan()));
  EXPECT_EQ(*must(reader->stimulus()), field->stimulus(-history_s({}), 0.025));
  std::vector<float> truth(kSmall.pixels());
  std::vector<float> row(24);
  for (std::size_t k = 0; k < 6; ++k) {
    ASSERT_TRUE(reader->read_truth(k, truth.data()));
    field->sample(static_cast<double>(k) / 200.0, 4, row);
    EXPECT_TRUE(std::ranges::equal(row, std::span(truth).subspan(4 * 24, 24))) << "frame " << k;
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
  const auto reader = must(capture::CaptureReader::open(scratch / "a.h5"));
  EXPECT_EQ(reader->t().size(), 3U);
}

}  // namespace bolo::sim::capture_file_test
