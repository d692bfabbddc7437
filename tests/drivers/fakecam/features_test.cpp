#include "drivers/fakecam/camera_features.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

namespace bolo::fakecam::features_test {
namespace {

class FeaturesTest : public testing::Test {
 protected:
  static StreamFormat full_sensor() {
    StreamFormat format;
    format.geometry = {640, 480};
    return format;  // kelvin at 200 Hz
  }
  gvcp::Status write(std::uint32_t address, std::uint32_t value) {
    std::array<std::uint8_t, 4> bytes{};
    store_u32(bytes, 0, value);
    return registers.write(address, bytes);
  }
  gvcp::Status write(std::uint32_t address, float value) { return write(address, std::bit_cast<std::uint32_t>(value)); }

  RegisterMap registers{""};
  Counters counters;
  bool streaming = false;
  gvcp::Status start_answer = gvcp::Status::kSuccess;
  int stops = 0;
  int windowings = 0;
  CameraFeatures features{
      registers,
      counters,
      full_sensor(),
      {640, 480},
      200.0,
      {[this] { return start_answer; }, [this] { ++stops; }, [this] { return streaming; }, [this] { ++windowings; }}};
};

TEST_F(FeaturesTest, WindowingReadsTheMiddleRows) {
  EXPECT_EQ(features.region(), (Region{0, 0, 640, 480}));
  EXPECT_EQ(write(reg::kIrWindowing, 1U), gvcp::Status::kSuccess);
  EXPECT_EQ(features.region(), (Region{0, 120, 640, 240}));
  EXPECT_EQ(write(reg::kIrWindowing, 2U), gvcp::Status::kSuccess);
  EXPECT_EQ(write(reg::kIrWindowing, 2U), gvcp::Status::kSuccess);
  EXPECT_EQ(windowings, 2) << "writing the same again changes nothing";
  EXPECT_EQ(features.region(), (Region{0, 180, 640, 120}));
  EXPECT_EQ(registers.get(reg::kPayloadSize), 153600U);
  EXPECT_EQ(write(reg::kIrWindowing, 3U), gvcp::Status::kInvalidParameter);
}

TEST_F(FeaturesTest, WindowStaysInTheMiddleUntilAnOffsetIsGiven) {
  write(reg::kHeight, 120U);
  write(reg::kWidth, 320U);
  EXPECT_EQ(features.region(), (Region{160, 180, 320, 120}));
  EXPECT_EQ(write(reg::kOffsetY, 7U), gvcp::Status::kSuccess);
  write(reg::kHeight, 100U);
  EXPECT_EQ(features.region(), (Region{160, 7, 320, 100}));
}

TEST_F(FeaturesTest, NoWindowReachesBeyondTheSensor) {
  EXPECT_EQ(write(reg::kWidth, 641U), gvcp::Status::kInvalidParameter);
  EXPECT_EQ(write(reg::kHeight, 0U), gvcp::Status::kInvalidParameter);
  write(reg::kHeight, 100U);
  EXPECT_EQ(write(reg::kOffsetY, 381U), gvcp::Status::kInvalidParameter);
  EXPECT_EQ(write(reg::kOffsetY, 380U), gvcp::Status::kSuccess);
  write(reg::kHeight, 480U);
  EXPECT_EQ(features.region(), (Region{0, 0, 640, 480})) << "the offset gives way";
}

TEST_F(FeaturesTest, ImageIsLockedWhileItStreams) {
  streaming = true;
  for (const auto address : {reg::kWidth, reg::kHeight, reg::kOffsetX, reg::kOffsetY, reg::kIrFormat}) {
    EXPECT_EQ(write(address, 1U), gvcp::Status::kBusy);
  }
  EXPECT_EQ(write(reg::kObjectEmissivity, 0.5F), gvcp::Status::kSuccess);
}

TEST_F(FeaturesTest, RateIsTheCapturesOwnUntilAnotherIsWritten) {
  EXPECT_EQ(features.rate_hz(), 0.0);
  EXPECT_EQ(write(reg::kFrameRate, 50.0F), gvcp::Status::kSuccess);
  EXPECT_EQ(features.rate_hz(), 50.0);
  EXPECT_EQ(write(reg::kFrameRate, 200.0F), gvcp::Status::kSuccess);
  EXPECT_EQ(features.rate_hz(), 0.0);
  EXPECT_EQ(write(reg::kFrameRate, 0.0F), gvcp::Status::kInvalidParameter);
  EXPECT_EQ(write(reg::kFrameRate, std::numeric_limits<float>::quiet_NaN()), gvcp::Status::kInvalidParameter);
}

TEST_F(FeaturesTest, CommandsActAndReadBackZero) {
  EXPECT_EQ(write(reg::kNucAction, 1U), gvcp::Status::kSuccess);
  EXPECT_EQ(write(reg::kNucAction, 1U), gvcp::Status::kSuccess);
  EXPECT_EQ(registers.get(reg::kNucAction), 0U);
  EXPECT_EQ(registers.get(reg::kNucCount), 2U);
  EXPECT_EQ(counters.read().nuc_actions, 2U);
  write(reg::kAcquisitionStop, 1U);
  EXPECT_EQ(stops, 1);
  start_answer = gvcp::Status::kWrongConfig;
  EXPECT_EQ(write(reg::kAcquisitionStart, 1U), gvcp::Status::kWrongConfig);
}

TEST_F(FeaturesTest, QueryCaseShowsThatRangesLimits) {
  write(reg::kQueryCase, 2U);
  EXPECT_FLOAT_EQ(registers.get_float(reg::kQueryCaseLowLimit), 573.15F);
  EXPECT_EQ(write(reg::kQueryCase, 3U), gvcp::Status::kInvalidParameter);
  EXPECT_FLOAT_EQ(registers.get_float(reg::kQueryCaseLowLimit), 573.15F);
}

TEST_F(FeaturesTest, FormatFollowsTheCapturesUnit) {
  EXPECT_EQ(features.ir_format(), IrFormat::kTemperatureLinear10mK);
  EXPECT_EQ(write(reg::kIrFormat, 1U), gvcp::Status::kSuccess);
  EXPECT_EQ(features.ir_format(), IrFormat::kTemperatureLinear100mK);
  EXPECT_EQ(write(reg::kIrFormat, 3U), gvcp::Status::kInvalidParameter);
}

}  // namespace
}  // namespace bolo::fakecam::features_test
