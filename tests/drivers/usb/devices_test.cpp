#include "drivers/usb/devices.hpp"
#include "tests/drivers/usb/mock_camera.hpp"
#include "tests/refusal.hpp"

namespace bolo::usb::devices_test {

using testing::MockCamera;

DeviceFilter flir() { return {.vendor = 0x09cb}; }

TEST(Devices, OfOtherVendorsAndSerialsAreLeftOut) {
  MockCamera camera("SN-7", 0x04a9);
  camera.plug();
  EXPECT_TRUE(list_devices(flir())->empty());
  EXPECT_EQ(list_devices(DeviceFilter{})->size(), 1U);
  EXPECT_TRUE(list_devices({.serial = "SN-8"})->empty());
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
