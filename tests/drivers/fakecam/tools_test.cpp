// Programs that others wrote, run against the fake camera. Each test skips when its program is not installed.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/drivers/fakecam/synthetic.hpp"

namespace bolo::fakecam {
namespace {

constexpr Geometry kGeometry{640, 120};

bool installed(const std::string& program) {
  return std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) == 0;
}

// Runs a command line, at most a minute; returns what it printed.
std::string run(const std::string& command, int& exit_code) {
  FILE* pipe = popen(("timeout 60 " + command + " 2>&1").c_str(), "r");
  std::string output;
  std::array<char, 4096> buffer{};
  for (std::size_t n = 0; (n = fread(buffer.data(), 1, buffer.size(), pipe)) > 0;) output.append(buffer.data(), n);
  exit_code = pclose(pipe);
  return output;
}

std::string run(const std::string& command) {
  int ignored = 0;
  return run(command, ignored);
}

// As root, Aravis receives through a packet socket, which takes in other cameras' packets until its filter is attached.
// Without the right to raw sockets it uses a plain one.
std::string without_raw_sockets() {
  return geteuid() == 0 && installed("setpriv") ? "setpriv --bounding-set -net_raw " : "";
}

std::unique_ptr<FakeCamera> serve(const std::string& address, std::size_t frames, std::uint64_t laps) {
  FakeCameraOptions options;
  options.address = address;
  options.laps = laps;
  return test::serve(test::provider_of(test::synthetic(kGeometry, frames)), options);
}

TEST(FakeCameraTools, ArvToolReadsAndWritesFeatures) {
  if (!installed("arv-tool-0.8")) GTEST_SKIP() << "arv-tool-0.8 (aravis-tools-cli) is not installed";
  const auto address = test::fresh_address();
  const auto camera = serve(address, 2, 1);
  const auto features = run("arv-tool-0.8 -a " + address + " features");
  for (const char* name : {"IRFormat", "IRWindowing", "NUCAction", "ObjectEmissivity", "QueryCaseHighLimit", "alpha2",
                           "AcquisitionFrameRate", "GevSCPSPacketSize"}) {
    EXPECT_NE(features.find(std::string("'") + name + "'"), std::string::npos) << name << " missing in\n" << features;
  }
  const auto output = run("arv-tool-0.8 -a " + address +
                          " control IRWindowing=Half Height OffsetY ObjectEmissivity=0.5 NUCAction NUCCount "
                          "IRFormat=TemperatureLinear100mK DeviceSerialNumber");
  for (const char* line : {"Height = 60 ", "OffsetY = 30 ", "ObjectEmissivity = 0.5 ", "NUCCount = 1 ",
                           "IRFormat = TemperatureLinear100mK", "DeviceSerialNumber = BOLO7f"}) {
    EXPECT_NE(output.find(line), std::string::npos) << line << " missing in\n" << output;
  }
}

TEST(FakeCameraTools, ArvToolListsIt) {
  if (!installed("arv-tool-0.8")) GTEST_SKIP() << "arv-tool-0.8 (aravis-tools-cli) is not installed";
  const auto address = test::fresh_address();
  const auto camera = serve(address, 2, 1);
  if (!camera->hears_broadcasts()) GTEST_SKIP() << "another program holds the broadcast address alone";
  const auto output = run("arv-tool-0.8");
  EXPECT_NE(output.find("(" + address + ")"), std::string::npos) << output;
}

TEST(FakeCameraTools, ArvCameraTestReceivesWithoutFailures) {
  if (!installed("arv-camera-test-0.8")) GTEST_SKIP() << "arv-camera-test-0.8 (aravis-tools) is not installed";
  const auto address = test::fresh_address();
  const auto camera = serve(address, 100, 0);
  int exit_code = -1;
  const auto output =
      run("arv-camera-test-0.8 -n " + address + " --no-packet-socket -a -f 200 -w 640 -h 120 --duration=2", exit_code);
  EXPECT_EQ(exit_code, 0) << output;
  EXPECT_NE(output.find("image height           = 120"), std::string::npos) << output;
  EXPECT_NE(output.find("n_size_mismatch_errors = 0"), std::string::npos) << output;
  EXPECT_NE(output.find("n_error_packets        = 0"), std::string::npos) << output;
  EXPECT_GE(camera->stats().frames_sent, 100U) << output;
  EXPECT_EQ(camera->stats().send_errors, 0U);
}

TEST(FakeCameraTools, GstreamerReceivesExactFrames) {
  if (!installed("gst-launch-1.0") || run("gst-inspect-1.0 aravissrc").find("Factory") == std::string::npos) {
    GTEST_SKIP() << "gst-launch-1.0 (gstreamer1.0-tools) or aravissrc is not installed";
  }
  const auto address = test::fresh_address();
  constexpr std::size_t kFrames = 100;
  const auto camera = serve(address, kFrames, 0);
  std::string file = testing::TempDir() + "fakecam_XXXXXX";
  close(mkstemp(file.data()));
  int exit_code = -1;
  const auto output = run(without_raw_sockets() + "gst-launch-1.0 -q aravissrc camera-name=" + address +
                              " packet-size=9000 num-buffers=100 ! "
                              "video/x-raw,format=GRAY16_LE,width=640,height=120,framerate=200/1 ! filesink location=" +
                              file,
                          exit_code);
  EXPECT_EQ(exit_code, 0) << output;
  std::ifstream in(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  std::filesystem::remove(file);
  ASSERT_EQ(bytes.size(), kFrames * kGeometry.pixels() * 2);
  // Each frame is one of the capture's to the last bit, in order. A busy machine may lose some on the way.
  const auto value_at = [&bytes](std::size_t at) {
    return static_cast<std::uint16_t>(static_cast<unsigned char>(bytes[at]) | static_cast<unsigned char>(bytes[at + 1])
                                                                                  << 8U);
  };
  std::size_t next = 0;
  for (std::size_t f = 0; f < kFrames; ++f, ++next) {
    const std::size_t start = f * kGeometry.pixels() * 2;
    const std::size_t lost_before = next;
    while (test::pixel_of(next % kFrames, 0) != value_at(start)) ASSERT_LT(++next, lost_before + kFrames);
    for (std::size_t p = 0; p < kGeometry.pixels(); ++p) {
      ASSERT_EQ(value_at(start + p * 2), test::pixel_of(next % kFrames, p)) << "frame " << f << " pixel " << p;
    }
  }
}

}  // namespace
}  // namespace bolo::fakecam
