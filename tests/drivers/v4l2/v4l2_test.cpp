// Bytes written to a video device; the sink on a device that works, is busy, goes away, comes back, or never returns
// from a write.
#include "drivers/v4l2/image.hpp"
#include "drivers/v4l2/v4l2_sink.hpp"
#include "tests/drivers/v4l2/fake_port.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::v4l2::v4l2_test {

using test::FakeDevice;
using test::FakePort;

constexpr Geometry kTiny{4, 2};
constexpr LinearScale k10mK{Unit::kKelvin, 0.01, 0.0};
constexpr LinearScale k100mK{Unit::kKelvin, 0.1, 0.0};
constexpr LinearScale kCounts{Unit::kCount, 1.0, 0.0};
constexpr AgcOptions kFixed{.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0};
const std::vector<std::uint16_t> kPlane{28000, 29000, 29500, 30000, 30500, 31000, 32000, 65535};

std::vector<int> image(PixelFormat format, Y16Unit unit, const LinearScale& scale,
                       const std::vector<std::uint16_t>& plane = kPlane) {
  auto maker = must(ImageMaker::create(format, unit, kTiny, scale, kFixed));
  std::vector<int> bytes;
  for (const std::byte b : maker->make(plane, 0.005, true)) bytes.push_back(std::to_integer<int>(b));
  return bytes;
}

std::vector<int> words(const std::vector<int>& bytes) {
  std::vector<int> values;
  for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) values.push_back(bytes[i] | bytes[i + 1] << 8);
  return values;
}

TEST(Image, Y16IsInItsUnitAndWithin16Bits) {
  const std::vector<int> same(kPlane.begin(), kPlane.end());
  struct Case {
    Y16Unit unit;
    LinearScale scale;
    std::vector<std::uint16_t> plane;
    std::vector<int> expected;
  };
  const Case cases[]{
      {Y16Unit::k10mK, k10mK, kPlane, same},
      {Y16Unit::k100mK, k100mK, kPlane, same},
      {Y16Unit::k100mK, kCounts, kPlane, same},
      {Y16Unit::k100mK, k10mK, {30004, 30006, 0, 4, 6, 65534, 1, 9}, {3000, 3001, 0, 0, 1, 6553, 0, 1}},
      {Y16Unit::k10mK, k100mK, {2932, 6553, 6554, 65535, 0, 0, 0, 0}, {29320, 65530, 65535, 65535, 0, 0, 0, 0}},
      {Y16Unit::k10mK,
       {Unit::kKelvin, 0.01, 273.15},
       {0, 1, 0, 0, 0, 0, 0, 2000},
       {27315, 27316, 27315, 27315, 27315, 27315, 27315, 29315}}};
  for (const Case& c : cases) EXPECT_EQ(words(image(PixelFormat::kY16, c.unit, c.scale, c.plane)), c.expected);
}

TEST(Image, GreyIsOneByteAPixelAndYuyvTheSameWithNeutralColour) {
  EXPECT_EQ(image(PixelFormat::kGrey, Y16Unit::k10mK, k10mK), (std::vector<int>{0, 0, 64, 128, 191, 255, 255, 255}));
  EXPECT_EQ(image(PixelFormat::kYuyv, Y16Unit::k10mK, k10mK),
            (std::vector<int>{0, 128, 0, 128, 64, 128, 128, 128, 191, 128, 255, 128, 255, 128, 255, 128}));
}

TEST(Image, YuyvNeedsAnEvenWidth) {
  expect_refused(ImageMaker::create(PixelFormat::kYuyv, Y16Unit::k10mK, {3, 2}, k10mK, kFixed), {"3"});
  EXPECT_TRUE(ImageMaker::create(PixelFormat::kGrey, Y16Unit::k10mK, {3, 2}, k10mK, kFixed));
}

// --- Grey levels for temperatures.

constexpr double kFrameS = 0.005;

// Consecutive counts from `first`, one per pixel.
std::vector<std::uint16_t> ramp(std::uint16_t first, std::size_t pixels) {
  std::vector<std::uint16_t> plane(pixels);
  std::iota(plane.begin(), plane.end(), first);
  return plane;
}

TEST(Agc, AFixedRangeIsWhatItWasSetToInKelvinOrCounts) {
  Agc kelvin(k10mK, {.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0});
  EXPECT_DOUBLE_EQ(kelvin.next(ramp(0, 1000), kFrameS, true).black, 29000.0);
  EXPECT_DOUBLE_EQ(kelvin.next(ramp(0, 1000), kFrameS, true).white, 31000.0);
  Agc counts(kCounts, {.gain = Gain::kFixed, .low_k = 1000.0, .high_k = 3000.0});
  EXPECT_DOUBLE_EQ(counts.next(ramp(0, 1000), kFrameS, true).black, 1000.0);
  EXPECT_DOUBLE_EQ(counts.next(ramp(0, 1000), kFrameS, true).white, 3000.0);
}

TEST(Agc, TheFirstFramesPercentilesHoldAtOnce) {
  Agc agc(k10mK, {.low_percent = 10.0, .high_percent = 90.0});
  const CountRange range = agc.next(ramp(30000, 1001), kFrameS, true);
  EXPECT_NEAR(range.black, 30100.0, 1.0);
  EXPECT_NEAR(range.white, 30900.0, 1.0);
}

TEST(Agc, FollowsWithItsTimeConstant) {
  Agc agc(k10mK, {.smooth_s = 1.0});
  const double before = agc.next(ramp(30000, 1000), kFrameS, true).black;
  CountRange range;
  for (int frame = 0; frame < 200; ++frame) range = agc.next(ramp(31000, 1000), kFrameS, true);  // one second
  EXPECT_NEAR(range.black, before + 1000.0 * (1.0 - std::exp(-1.0)), 2.0);
  EXPECT_NEAR(range.white - range.black, 980.0, 25.0) << "both ends move alike";
}

TEST(Agc, OneHotPixelChangesNothing) {
  Agc agc(k10mK, {.smooth_s = 0.0});
  auto plane = ramp(30000, 2000);
  const CountRange before = agc.next(plane, kFrameS, true);
  plane[7] = 65535;
  const CountRange after = agc.next(plane, kFrameS, true);
  EXPECT_NEAR(after.white, before.white, 1.5);
}

TEST(Agc, AFlatSceneHasARangeAndKeepsTheLeastSpan) {
  const std::vector<std::uint16_t> flat(1000, 30000);
  const CountRange range = Agc(k10mK, {.least_span_k = 2.0}).next(flat, kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 29900.0);
  EXPECT_DOUBLE_EQ(range.white, 30100.0);
  const CountRange least = Agc(k10mK, {.least_span_k = 0.0}).next(flat, kFrameS, true);
  EXPECT_LT(least.black, least.white);
}

TEST(Agc, TheShutterDoesNotMoveTheRangeAndItsFirstFrameIsForgotten) {
  Agc agc(k10mK, {.smooth_s = 0.1});
  agc.next(ramp(20000, 1000), kFrameS, false);
  const CountRange before = agc.next(ramp(30000, 1000), kFrameS, true);
  EXPECT_NEAR(before.black, 30010.0, 2.0);
  for (int frame = 0; frame < 100; ++frame) {
    EXPECT_DOUBLE_EQ(agc.next(ramp(20000, 1000), kFrameS, false).black, before.black);
  }
}

TEST(Agc, TakesUpOtherOptions) {
  Agc agc(k10mK, {});
  agc.next(ramp(30000, 1000), kFrameS, true);
  agc.set_options({.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0});
  EXPECT_DOUBLE_EQ(agc.next(ramp(30000, 1000), kFrameS, true).black, 29000.0);
}

TEST(Grey, EndsAreBlackAndWhiteAndWhatLiesBeyondIsToo) {
  const CountRange range{29000.0, 31000.0};
  EXPECT_EQ(grey(0, range), 0);
  EXPECT_EQ(grey(29000, range), 0);
  EXPECT_EQ(grey(30000, range), 128);
  EXPECT_EQ(grey(31000, range), 255);
  EXPECT_EQ(grey(65535, range), 255);
}

using namespace std::chrono_literals;

constexpr Geometry kGeometry{64, 24};

pipeline::SinkFormat format() {
  pipeline::SinkFormat format;
  format.source.format.geometry = kGeometry;
  format.source.format.scale = {Unit::kKelvin, 0.01, 0.0};
  return format;
}

class V4l2SinkTest : public testing::Test {
 protected:
  V4l2SinkTest() : stats_(inlet_), raw_(kGeometry.pixels()), sharp_(kGeometry.pixels()) {}

  void make(const V4l2Options& options = {}) {
    sink_ = std::make_unique<V4l2Sink>(options, std::make_unique<FakePort>(device_));
  }
  void start(const V4l2Options& options = {}) {
    make(options);
    must(sink_->open(format()));
  }
  // Frame `value`: raw planes hold it, deblurred ones twice that.
  void publish(std::uint16_t value) {
    std::fill(raw_.begin(), raw_.end(), value);
    std::fill(sharp_.begin(), sharp_.end(), static_cast<std::uint16_t>(2 * value));
    pipeline::PublishedFrame frame;
    frame.raw = raw_.data();
    frame.deblurred = sharp_.data();
    frame.publish_ns = ++time_ns_;
    sink_->publish(frame, stats_);
  }
  bool shows(std::uint16_t value) {
    return device_->await([&] {
      return device_->last.size() == kGeometry.pixels() * 2 &&
             device_->last[0] == std::byte{static_cast<std::uint8_t>(value & 0xFF)} &&
             device_->last[1] == std::byte{static_cast<std::uint8_t>(value >> 8)};
    });
  }
  // Publishes until the condition holds, like a camera that keeps running.
  template <typename Condition>
  bool publish_until(Condition condition) {
    for (int i = 0; i < 12'000; ++i) {
      publish(1);
      if (condition()) return true;
      std::this_thread::sleep_for(5ms);
    }
    return false;
  }

  std::shared_ptr<FakeDevice> device_ = std::make_shared<FakeDevice>();
  pipeline::FrameInlet inlet_{format().source.format, 4, 4};
  pipeline::PipelineStats stats_;
  std::vector<std::uint16_t> raw_;
  std::vector<std::uint16_t> sharp_;
  std::int64_t time_ns_ = 0;
  std::unique_ptr<V4l2Sink> sink_;
};

TEST_F(V4l2SinkTest, ShowsThePlaneThatWasAskedFor) {
  start();
  publish(1000);
  EXPECT_TRUE(shows(2000));
  sink_->close();
  EXPECT_EQ(sink_->stats().written.value(), 1U);
  EXPECT_EQ(sink_->stats().dropped.value(), 0U);

  start({.plane = Plane::kRaw});
  publish(1000);
  EXPECT_TRUE(shows(1000));
}

TEST_F(V4l2SinkTest, RefusesWhatIsNoWholeFrameOf16Bits) {
  make();
  pipeline::SinkFormat part = format();
  part.region = Region{0, 0, 8, 8};
  EXPECT_FALSE(sink_->open(part));
  pipeline::SinkFormat wide = format();
  wide.deblurred_type = PixelType::kFloat32;
  EXPECT_FALSE(sink_->open(wide));
  EXPECT_EQ(device_->opened, 0);
}

TEST_F(V4l2SinkTest, IsNotOpenedWithoutItsDevice) {
  device_->there = false;
  make();
  expect_refused(sink_->open(format()), {"/dev/video10 is not there"});
}

TEST_F(V4l2SinkTest, ABusyDeviceCostsFramesAndNothingElse) {
  device_->answer = EAGAIN;
  start();
  EXPECT_TRUE(publish_until([&] { return sink_->stats().dropped.value() >= 3; }));
  device_->set([&] { device_->answer = 0; });
  EXPECT_TRUE(publish_until([&] { return sink_->stats().written.value() >= 3; }));
  EXPECT_EQ(sink_->stats().failures.value(), 0U);
  EXPECT_TRUE(sink_->take_notices().empty());
}

TEST_F(V4l2SinkTest, AStuckDeviceHoldsUpNobodyAndGetsTheNewestFrameAfterwards) {
  start();
  device_->set([&] { device_->stuck = true; });
  publish(1);
  ASSERT_TRUE(device_->await([&] { return device_->writes == 1; }));
  for (std::uint16_t value = 2; value <= 500; ++value) publish(value);  // must not block, though the device does
  EXPECT_EQ(sink_->stats().dropped.value(), 498U) << "frames 2 to 499";
  device_->set([&] { device_->stuck = false; });
  EXPECT_TRUE(shows(1000));
  sink_->close();
  EXPECT_EQ(sink_->stats().written.value(), 2U);
}

TEST_F(V4l2SinkTest, ADeviceThatNeverReturnsDoesNotHoldUpTheEnd) {
  start();
  device_->set([&] { device_->stuck = true; });
  publish(1);
  ASSERT_TRUE(device_->await([&] { return device_->writes == 1; }));
  sink_->close();
  sink_.reset();
  device_->set([&] { device_->stuck = false; });
  EXPECT_TRUE(device_->await([&] { return device_->closed > 0; })) << "its thread ends once it can";
}

TEST_F(V4l2SinkTest, ADeviceThatVanishesIsOpenedAgainWhenItIsBack) {
  start();
  publish(1);
  ASSERT_TRUE(shows(2));
  device_->set([&] { device_->there = false; });
  ASSERT_TRUE(publish_until([&] { return sink_->stats().failures.value() == 1; }));
  EXPECT_FALSE(sink_->stats().open.value());
  const std::uint64_t dropped = sink_->stats().dropped.value();
  ASSERT_TRUE(publish_until([&] { return sink_->stats().dropped.value() > dropped + 2; }));
  device_->set([&] {
    device_->there = true;
    device_->refused = 2;
  });
  ASSERT_TRUE(publish_until([&] { return sink_->stats().open.value(); }));
  const std::uint64_t written = sink_->stats().written.value();
  EXPECT_TRUE(publish_until([&] { return sink_->stats().written.value() > written; }));
  EXPECT_EQ(sink_->stats().failures.value(), 1U);
  const auto notices = sink_->take_notices();
  ASSERT_EQ(notices.size(), 2U) << "one line each change";
  EXPECT_TRUE(notices[0].warning);
  EXPECT_NE(notices[0].text.find("/dev/video10 takes no more frames (No such device)"), std::string::npos);
  EXPECT_FALSE(notices[1].warning);
  EXPECT_NE(notices[1].text.find("/dev/video10 is back after"), std::string::npos);
}

TEST_F(V4l2SinkTest, ADeviceThatOpensAndTakesNothingIsLostOnce) {
  start();
  device_->set([&] { device_->answer = EINVAL; });
  ASSERT_TRUE(publish_until([&] { return device_->await([&] { return device_->opened >= 3; }, 0s); }));
  EXPECT_FALSE(sink_->stats().open.value());
  EXPECT_EQ(sink_->take_notices().size(), 1U);
  device_->set([&] { device_->answer = 0; });
  EXPECT_TRUE(publish_until([&] { return sink_->stats().open.value(); }));
  EXPECT_EQ(sink_->take_notices().size(), 1U) << "it is back";
}

TEST_F(V4l2SinkTest, TakesUpOtherTonesWhileItRuns) {
  start({.format = PixelFormat::kGrey, .agc = {.gain = Gain::kFixed, .low_k = 0.0, .high_k = 100.0}});
  const auto grey_is = [&](int grey) {
    return publish_until([&] {
      const std::lock_guard lock(device_->mutex);
      return device_->last.size() == kGeometry.pixels() && std::to_integer<int>(device_->last[0]) == grey;
    });
  };
  EXPECT_TRUE(grey_is(0)) << "20 mK of 100 K";
  sink_->reload(V4l2Section("v4l2", "", {.agc = {.gain = Gain::kFixed, .low_k = 0.0, .high_k = 0.02}}));
  EXPECT_TRUE(grey_is(255));
}

// --- Error messages for paths that are no v4l2loopback device. The real module is tested where it can be loaded.

void refused(const std::string& path, const std::string& why) {
  LoopbackPort port(path);
  expect_refused(port.open({PixelFormat::kY16, {640, 120}, 0.005}), {path + " is " + why});
  port.close();
}

TEST(LoopbackPort, SaysWhatIsThereInsteadOrHowToMakeIt) {
  refused("/dev/video4711", "not there: modprobe v4l2loopback video_nr=4711 exclusive_caps=1");
  refused("/dev/null", "no video device, not v4l2loopback: modprobe v4l2loopback video_nr=10 exclusive_caps=1");
  refused("/dev", "a folder, not v4l2loopback");
}

TEST(LoopbackPort, RefusesAFileAndLeavesItAlone) {
  const Scratch folder;
  const std::string file = folder / "no-device";
  std::ofstream(file) << "precious";
  refused(file, "no device, not v4l2loopback: modprobe");
  std::string content;
  std::ifstream(file) >> content;
  EXPECT_EQ(content, "precious");
}

}  // namespace bolo::v4l2::v4l2_test
