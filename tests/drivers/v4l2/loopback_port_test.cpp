// What is said of paths that are no v4l2loopback device. The real module is tested where it can be loaded.
#include "drivers/v4l2/video_port.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/scratch.hpp"

namespace bolo::v4l2::loopback_port_test {
namespace {

std::string refusal(const std::string& path) {
  LoopbackPort port(path);
  const Status opened = port.open({PixelFormat::kY16, {640, 120}, 0.005});
  if (opened) return "it was opened";
  EXPECT_EQ(opened.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(opened.error().message.find('\n'), std::string::npos);
  return opened.error().message;
}

TEST(LoopbackPort, SaysHowToMakeAMissingDevice) {
  EXPECT_EQ(refusal("/dev/video4711"),
            "/dev/video4711 is not there: modprobe v4l2loopback video_nr=4711 exclusive_caps=1");
}

TEST(LoopbackPort, RefusesACharacterDeviceThatIsNoVideo) {
  EXPECT_EQ(refusal("/dev/null"),
            "/dev/null is no video device, not v4l2loopback: modprobe v4l2loopback video_nr=10 exclusive_caps=1");
}

TEST(LoopbackPort, RefusesAFileAndLeavesItAlone) {
  const Scratch folder;
  const std::string file = folder / "no-device";
  std::ofstream(file) << "precious";
  EXPECT_EQ(refusal(file).find(file + " is no device, not v4l2loopback: modprobe"), 0U) << refusal(file);
  std::string content;
  std::ifstream(file) >> content;
  EXPECT_EQ(content, "precious");
}

TEST(LoopbackPort, RefusesAFolder) { EXPECT_EQ(refusal("/dev").find("/dev is a folder, not v4l2loopback"), 0U); }

TEST(LoopbackPort, CanBeClosedTwice) {
  LoopbackPort port("/dev/null");
  port.close();
  port.close();
  EXPECT_EQ(port.path(), "/dev/null");
}

}  // namespace
}  // namespace bolo::v4l2::loopback_port_test
