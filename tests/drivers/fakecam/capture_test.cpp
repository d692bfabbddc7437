// Captures as the fake camera's frames.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "tests/drivers/fakecam/raw_client.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"
#include "tests/scratch.hpp"

namespace bolo::fakecam::capture_test {
namespace {

void write_kelvin_capture(const std::filesystem::path& file, std::size_t frames) {
  capture::CaptureInfo info;
  info.format.geometry = {8, 4};
  info.format.type = PixelType::kFloat32;
  info.format.scale = {Unit::kKelvin, 1.0, 0.0};
  info.camera_serial = "63900123";
  auto writer = capture::CaptureWriter::create(file, info);
  ASSERT_TRUE(writer.has_value()) << writer.error().message;
  for (std::size_t f = 0; f < frames; ++f) {
    const std::vector<float> plane(32, 300.0F + static_cast<float>(f));
    ASSERT_TRUE(writer->append(1.0 + 0.005 * static_cast<double>(f), 10 + f, plane.data()).has_value());
  }
  ASSERT_TRUE(writer->close().has_value());
}

TEST(FakeCameraCapture, KelvinCaptureGoesOutIn10mKWithTheCamerasSerial) {
  const Scratch dir;
  write_kelvin_capture(dir / "a.h5", 3);
  auto provider = open_capture(dir / "a.h5");
  ASSERT_TRUE(provider.has_value()) << provider.error().message;
  const std::string address = test::fresh_address();
  const auto camera = test::serve(std::move(*provider), address);
  ASSERT_TRUE(camera);
  EXPECT_EQ(camera->serial(), "63900123");
  test::Session session(address);
  session.start();
  const auto blocks = test::receive_blocks(session.stream, 3);
  ASSERT_EQ(blocks.size(), 3U);
  EXPECT_EQ(blocks[2].first, 13);
  EXPECT_EQ(blocks[2].second.pixels(), std::vector<std::uint16_t>(32, 30200));
}

TEST(FakeCameraCapture, ReadsAheadFromDiskWhatIsTooBigForMemory) {
  const Scratch dir;
  write_kelvin_capture(dir / "a.h5", 40);
  auto from_memory = open_capture(dir / "a.h5");
  auto from_disk = open_capture(dir / "a.h5", 1000);
  ASSERT_TRUE(from_memory.has_value() && from_disk.has_value());
  EXPECT_NE(dynamic_cast<MemoryFrames*>(from_memory->get()), nullptr);
  EXPECT_EQ(dynamic_cast<MemoryFrames*>(from_disk->get()), nullptr);
  const std::string address = test::fresh_address();
  const auto camera = test::serve(std::move(*from_disk), address);
  ASSERT_TRUE(camera);
  test::Session session(address);
  session.start();
  const auto blocks = test::receive_blocks(session.stream, 40);
  ASSERT_EQ(blocks.size(), 40U);
  EXPECT_EQ(blocks[39].second.pixels(), std::vector<std::uint16_t>(32, 33900));
}

TEST(FakeCameraCapture, MissingFileIsBadInput) {
  const auto provider = open_capture("/nonexistent.h5");
  ASSERT_FALSE(provider.has_value());
  EXPECT_EQ(provider.error().kind, ErrorKind::kBadInput);
}

TEST(FakeCameraCapture, RealDriveGoesOutAsItIs) {
  const char* data = std::getenv("BOLO_TEST_DATA");
  if (data == nullptr) GTEST_SKIP() << "BOLO_TEST_DATA is not set: no real captures";
  const auto file = std::filesystem::path(data) / "captures/a65_drive_a.h5";
  auto provider = open_capture(file);
  ASSERT_TRUE(provider.has_value()) << provider.error().message;
  ASSERT_EQ((*provider)->format().type, PixelType::kUint16);
  std::vector<std::uint16_t> expected((*provider)->format().geometry.pixels());
  ASSERT_TRUE((*provider)->read(1, expected.data()).has_value());
  FakeCameraOptions options;
  options.address = test::fresh_address();
  options.burst_gap_ns = 200'000;
  const auto camera = test::serve(std::move(*provider), options);
  ASSERT_TRUE(camera);
  test::Session session(options.address);
  session.client.write(reg::kStreamPacketSize, 9000);
  session.start();
  const auto blocks = test::receive_blocks(session.stream, 2);
  ASSERT_EQ(blocks.size(), 2U);
  EXPECT_EQ(blocks[1].second.pixels(), expected);
}

}  // namespace
}  // namespace bolo::fakecam::capture_test
