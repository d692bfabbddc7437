// `bolo usb` as its users meet it, with an emulated camera that it finds in another process.
#include <nlohmann/json.hpp>

#include "tests/drivers/usb/mock_camera.hpp"
#include "tests/tools/program.hpp"

namespace bolo::usb::usb_verb_test {

using nlohmann::json;
using testing::MockCamera;

class UsbVerb : public tools::test::ProgramTest {
 protected:
  UsbVerb() : ProgramTest({BOLO_PROGRAM, "usb"}) {}
  void SetUp() override {
    setenv("LD_PRELOAD", UMOCKDEV_PRELOAD, 1);              // the program itself knows nothing of it
    setenv("ASAN_OPTIONS", "verify_asan_link_order=0", 1);  // it then comes before the sanitizer's library
  }
  void TearDown() override {
    unsetenv("LD_PRELOAD");
    unsetenv("ASAN_OPTIONS");
  }
  MockCamera camera_{"SN-77"};
};

TEST_F(UsbVerb, ListsTheCamera) {
  camera_.plug();
  const json devices = json::parse(printed({"--json"}))["devices"];
  ASSERT_EQ(devices.size(), 1U) << devices;
  EXPECT_EQ(devices[0]["id"], "09cb:1007");
  EXPECT_EQ(devices[0]["serial"], "SN-77");
  EXPECT_EQ(devices[0]["allowed"], true);
}

TEST_F(UsbVerb, SaysThatThereIsNone) { EXPECT_TRUE(printed({}).starts_with("no ")); }

TEST_F(UsbVerb, ReportsDescriptorsForSupport) {
  camera_.plug();
  expect_parts(printed({"--report", "--device", "09cb:1007"}), {"09cb:1007", "SN-77", "0x81", "bulk", "512"});
}

TEST_F(UsbVerb, BadInputIsOneLine) {
  refused_each("", "--vendor flir", "--device first", "--report --watch", "--report --device 09cb:0001");
}

}  // namespace bolo::usb::usb_verb_test
