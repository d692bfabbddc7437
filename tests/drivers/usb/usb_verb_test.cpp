// `bolo usb` with an emulated camera, found from another process.
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
    setenv("LD_PRELOAD", UMOCKDEV_PRELOAD, 1);              // the program itself does not know of the mock
    setenv("ASAN_OPTIONS", "verify_asan_link_order=0", 1);  // the preload comes before the sanitizer's library
  }
  void TearDown() override {
    unsetenv("LD_PRELOAD");
    unsetenv("ASAN_OPTIONS");
  }
  MockCamera camera_{"SN-77"};
};

TEST_F(UsbVerb, ListsTheCameraWithWhatTheKernelKnows) {
  camera_.plug();
  const json devices = json::parse(printed({"--json"}))["devices"];
  EXPECT_EQ(devices, json::parse(R"([{"bus": 1, "address": 1, "port": "1-2", "id": "09cb:1007", "speed": "480 Mbit/s",
      "manufacturer": "FLIR Systems", "product": "Mock microbolometer", "serial": "SN-77",
      "node": "/dev/bus/usb/001/001", "allowed": true}])"));
}

TEST_F(UsbVerb, SaysThatThereIsNone) { EXPECT_TRUE(printed({}).starts_with("no ")); }

TEST_F(UsbVerb, ReportsEveryDescriptorForSupport) {
  camera_.plug();
  expect_parts(
      printed({"--report", "--device", "09cb:1007"}),
      {"USB device 09cb:1007 at bus 1 address 1, port 1-2, 480 Mbit/s", "\"FLIR Systems\"", "USB release        2.10",
       "configuration 1: attributes 0xc0, self-powered, at most 100 mA, 1 interfaces",
       "interface 0, alternate setting 0: class 0xff (vendor specific), subclass 0x01, protocol 0x02, 0 endpoints",
       "interface 0, alternate setting 1", "\"Thermal stream\"", "05 24 ab cd ef",
       "endpoint 0x81: bulk in, packets of 512 bytes x 1, interval 0", "BOS: 1 capabilities",
       "capability 0x02 (USB 2.0 extension)", "06 00 00 00", "SN-77"});
}

TEST_F(UsbVerb, BadInputIsOneLine) {
  refused_each("", "--vendor flir", "--device first", "--report --watch", "--report --device 09cb:0001");
}

}  // namespace bolo::usb::usb_verb_test
