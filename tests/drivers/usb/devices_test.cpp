// Devices listed, reported, and seen to come and go.
#include "drivers/usb/devices.hpp"
#include "tests/drivers/usb/mock_camera.hpp"
#include "tests/refusal.hpp"

namespace bolo::usb::devices_test {

using testing::MockCamera;

DeviceFilter flir() { return {.vendor = 0x09cb}; }

TEST(Devices, AreListedWithWhatTheKernelKnows) {
  MockCamera camera("SN-7");
  camera.plug();
  const auto devices = must(list_devices(flir()));
  ASSERT_EQ(devices->size(), 1U);
  const UsbDevice& device = devices->front();
  EXPECT_EQ(device.bus, 1);
  EXPECT_EQ(device.address, camera.address());
  EXPECT_EQ(device.port_path, "1-2");
  EXPECT_EQ(id_text(device.vendor, device.product), "09cb:1007");
  EXPECT_EQ(device.speed, "480 Mbit/s");
  EXPECT_EQ(device.manufacturer, "FLIR Systems");
  EXPECT_EQ(device.product_name, "Mock microbolometer");
  EXPECT_EQ(device.serial, "SN-7");
  EXPECT_TRUE(device.allowed);
}

TEST(Devices, OfOtherVendorsAndSerialsAreLeftOut) {
  MockCamera camera("SN-7", 0x04a9);
  camera.plug();
  EXPECT_TRUE(list_devices(flir())->empty());
  EXPECT_EQ(list_devices(DeviceFilter{})->size(), 1U);
  EXPECT_TRUE(list_devices({.serial = "SN-8"})->empty());
}

TEST(Devices, ReportHoldsEveryDescriptor) {
  MockCamera camera;
  camera.plug();
  const auto report = must(descriptor_report(flir()));
  expect_parts(
      *report,
      {"USB device 09cb:1007 at bus 1 address 1, port 1-2, 480 Mbit/s", "\"FLIR Systems\"", "USB release        2.10",
       "configuration 1: attributes 0xc0, self-powered, at most 100 mA, 1 interfaces",
       "interface 0, alternate setting 0: class 0xff (vendor specific), subclass 0x01, protocol 0x02, 0 endpoints",
       "interface 0, alternate setting 1", "\"Thermal stream\"", "05 24 ab cd ef",
       "endpoint 0x81: bulk in, packets of 512 bytes x 1, interval 0", "BOS: 1 capabilities",
       "capability 0x02 (USB 2.0 extension)", "06 00 00 00"});
}

TEST(Devices, ReportOfNoneSaysWhichIsMissing) {
  MockCamera camera;
  expect_refused(descriptor_report(flir()), {"vendor 09cb"});
}

class HotplugBy : public ::testing::TestWithParam<Hotplug::Means> {};

TEST_P(HotplugBy, TellsWhatIsThereComesAndLeaves) {
  MockCamera camera;
  camera.plug();
  std::mutex mutex;
  std::vector<std::pair<Hotplug::Change, UsbDevice>> seen;
  const auto count = [&] {
    const std::lock_guard lock(mutex);
    return seen.size();
  };
  const auto note = [&](Hotplug::Change change, const UsbDevice& device) {
    const std::lock_guard lock(mutex);
    seen.emplace_back(change, device);
  };
  auto hotplug = must(Hotplug::start(flir(), note, GetParam()));
  ASSERT_TRUE(eventually([&] { return count() == 1; }));
  camera.unplug();
  ASSERT_TRUE(eventually([&] { return count() == 2; }));
  camera.plug();
  ASSERT_TRUE(eventually([&] { return count() == 3; }));
  hotplug->reset();
  EXPECT_EQ(seen[0].first, Hotplug::Change::kArrived);
  EXPECT_EQ(seen[1].first, Hotplug::Change::kLeft);
  EXPECT_EQ(seen[1].second.serial, "SN-1");
  EXPECT_EQ(seen[2].first, Hotplug::Change::kArrived);
  EXPECT_EQ(seen[2].second.address, 2);
}

INSTANTIATE_TEST_SUITE_P(Means, HotplugBy, ::testing::Values(Hotplug::Means::kEvents, Hotplug::Means::kPolling));

}  // namespace bolo::usb::devices_test
