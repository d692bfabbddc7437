// A camera whose clock PTP keeps: its state is told, and the clock is left alone.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "drivers/genicam/genicam_source.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"

namespace bolo::genicam::ptp_test {
namespace {

class Ptp : public testing::Test {
 protected:
  // Runs a source on a fake camera until it has said `wanted`; what it said.
  std::string run(bool ptp, const std::string& wanted) {
    fakecam::FakeCameraOptions fake;
    fake.address = fakecam::test::fresh_address();
    fake.laps = 0;
    camera_ = fakecam::test::serve(fakecam::test::provider_of(fakecam::test::synthetic({64, 32}, 20)), fake);
    CameraOptions options;
    options.address = fake.address;
    options.ir_format = IrFormat::kLeave;
    options.ptp = ptp;
    GenicamSource source(options);
    const auto info = source.open();
    EXPECT_TRUE(info) << info.error().message;
    if (!info) return {};
    pipeline::FrameInlet inlet(info->format, 4, 64);
    EXPECT_TRUE(source.start(inlet));
    std::string said;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(15);
    while (said.find(wanted) == std::string::npos && std::chrono::steady_clock::now() < end) {
      const auto arrival = inlet.next(20'000'000);
      if (arrival.slot != nullptr) inlet.give_back(*arrival.slot);
      for (const auto& notice : source.take_notices()) said += notice.text + "\n";
      if (wanted.empty() && inlet.received() > 5) break;
    }
    told_ = source.status()->ptp.value();
    offset_ns_ = source.status()->ptp_offset_ns.value();
    source.stop();
    return said;
  }

  std::unique_ptr<fakecam::FakeCamera> camera_;
  pipeline::PtpStatus told_ = pipeline::PtpStatus::kOff;
  std::int64_t offset_ns_ = 0;
};

TEST_F(Ptp, StateAndOffsetAreToldAndTheClockIsNotReset) {
  const std::string told = "PTP keeps the camera's clock, -37 ns from its master";
  const std::string said = run(true, told);
  EXPECT_NE(said.find(told), std::string::npos) << said;
  EXPECT_EQ(camera_->stats().clock_resets, 0U);
  EXPECT_EQ(told_, pipeline::PtpStatus::kSlave);
  EXPECT_EQ(offset_ns_, -37);
}

TEST_F(Ptp, WithoutItTheClockBeginsWithTheStream) {
  EXPECT_EQ(run(false, "").find("PTP"), std::string::npos);
  EXPECT_EQ(camera_->stats().clock_resets, 1U);
  EXPECT_EQ(told_, pipeline::PtpStatus::kOff);
}

}  // namespace
}  // namespace bolo::genicam::ptp_test
