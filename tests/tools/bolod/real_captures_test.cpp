// Real recordings end to end: fake camera, GigE Vision packets, bolod, shared memory, a reader. Every received raw
// plane equals the recording's, pixel by pixel.
#include "src/capture/capture.hpp"
#include "tests/tools/bolod/bolod_run.hpp"

namespace bolo::daemon::real_captures_test {

struct Recording {
  const char* file;
  Region crop;  // region of the recording's frames used as the camera's sensor
};

class RealCaptures : public BolodRun, public testing::WithParamInterface<Recording> {
 protected:
  void SetUp() override {
    const char* data = std::getenv("BOLO_TEST_DATA");
    if (data == nullptr) GTEST_SKIP() << "BOLO_TEST_DATA is unset: no real captures";
    capture_ = std::filesystem::path(data) / "captures" / GetParam().file;
  }

  // The recording's cropped planes, row-major.
  std::set<std::vector<std::uint16_t>> planes() const {
    const auto reader = must(capture::CaptureReader::open(capture_));
    const Geometry g = reader->info().format.geometry;
    const Region& crop = GetParam().crop;
    std::set<std::vector<std::uint16_t>> all;
    for (std::size_t i = 0; i < reader->info().frames; ++i) {
      const auto whole = tools::test::frame_values(*reader, i);
      std::vector<std::uint16_t> part;
      for (int y = crop.y; y < crop.y + crop.height; ++y) {
        const auto row = whole.begin() + static_cast<std::ptrdiff_t>(y) * g.width + crop.x;
        part.insert(part.end(), row, row + crop.width);
      }
      all.insert(std::move(part));
    }
    return all;
  }

  std::filesystem::path capture_;
};

TEST_P(RealCaptures, ReachAReaderPixelByPixel) {
  const Region crop = GetParam().crop;
  const std::string address = own_address();
  const std::string region = std::to_string(crop.x) + "," + std::to_string(crop.y) + "," + std::to_string(crop.width) +
                             "," + std::to_string(crop.height);
  const auto camera = start_camera(address, {"--rate", "100", "--crop", region}, capture_);
  const auto daemon = start_with(
      configure("address = '" + address + "'\nwidth = 0\nheight = 0\nrate_hz = 100.0\nir_format = 'leave'\n"));
  auto reader = attach(*daemon);
  EXPECT_EQ(reader->header().width, static_cast<std::uint32_t>(crop.width));
  EXPECT_EQ(reader->header().height, static_cast<std::uint32_t>(crop.height));

  const auto recorded = planes();
  std::set<std::vector<std::uint16_t>> seen;
  int frames = 0;
  int wrong = 0;
  EXPECT_TRUE(follow(*reader, [&](const ReadFrame& frame) {
    wrong += recorded.contains(frame.raw) ? 0 : 1;
    seen.insert(frame.raw);
    return ++frames == 200;
  })) << daemon->err();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(seen.size(), recorded.size() / 2) << "frames repeat";
  expect_good_end(*daemon);
}

INSTANTIATE_TEST_SUITE_P(Captures, RealCaptures,
                         testing::Values(Recording{"a65_drive_a.h5", {0, 196, 640, 120}},
                                         Recording{"lepton_hand_fast.h5", {0, 0, 160, 120}},
                                         Recording{"atto320_blackbody_25C.h5", {0, 0, 320, 240}}),
                         [](const auto& each) { return std::filesystem::path(each.param.file).stem().string(); });

}  // namespace bolo::daemon::real_captures_test
