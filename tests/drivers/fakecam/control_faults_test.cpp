// How the camera hears, and what it forgets.
#include <gtest/gtest.h>

#include "drivers/fakecam/control_faults.hpp"
#include "tests/drivers/fakecam/faults_fixture.hpp"

namespace bolo::fakecam {
namespace {

using Commands = ControlFaults::Commands;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart = 77'000 * kMs;

struct Camera {
  explicit Camera(std::initializer_list<std::string_view> texts) : tallies(test::script_of(texts)) {}
  Commands at(std::int64_t ms) { return faults.update(kStart + ms * kMs); }
  InjectedFault tally() const { return tallies.read().front(); }

  int dropped = 0;
  int reboots = 0;
  FaultTallies tallies;
  ControlFaults faults{tallies, test::kPeriodNs, {[this] { ++dropped; }, [this] { ++reboots; }}};
};

TEST(ControlFaults, NothingHappensBeforeTheFirstStream) {
  Camera camera({"reboot"});
  EXPECT_EQ(camera.at(5000), Commands::kAnswered);
  EXPECT_EQ(camera.reboots, 0);
}

TEST(ControlFaults, RebootIsOffForItsTimeAndForgetsOnce) {
  Camera camera({"reboot:at=1,for=0.5"});
  camera.faults.begin(kStart);
  EXPECT_EQ(camera.at(999), Commands::kAnswered);
  EXPECT_EQ(camera.at(1001), Commands::kDropped);
  EXPECT_EQ(camera.at(1400), Commands::kDropped);
  EXPECT_EQ(camera.at(1501), Commands::kAnswered);
  EXPECT_EQ(camera.reboots, 1);
  camera.faults.begin(kStart + 1600 * kMs);  // the client's next stream
  EXPECT_EQ(camera.at(2700), Commands::kAnswered);
  EXPECT_EQ(camera.reboots, 1);
  EXPECT_EQ(camera.tally().times, 1U);
}

TEST(ControlFaults, FreezeLeavesCommandsWaiting) {
  Camera camera({"freeze:at=1,for=0.5"});
  camera.faults.begin(kStart);
  EXPECT_EQ(camera.at(1200), Commands::kFrozen);
  EXPECT_EQ(camera.at(1501), Commands::kAnswered);
  EXPECT_EQ(camera.dropped + camera.reboots, 0);
}

TEST(ControlFaults, ControlLossDropsTheClientEachTime) {
  Camera camera({"control_loss:at=1,every=1"});
  camera.faults.begin(kStart);
  for (const std::int64_t ms : {500, 1000, 1500, 2100, 2900}) EXPECT_EQ(camera.at(ms), Commands::kAnswered);
  EXPECT_EQ(camera.dropped, 2);
  EXPECT_EQ(camera.tally().times, 2U);
}

TEST(ControlFaults, RequestsForPacketsAreLeftUnansweredAndCounted) {
  Camera camera({"resend_unanswered:at=1,for=1"});
  camera.faults.begin(kStart);
  EXPECT_TRUE(camera.faults.answers_resend(kStart));
  EXPECT_FALSE(camera.faults.answers_resend(kStart + 1500 * kMs));
  EXPECT_TRUE(camera.faults.answers_resend(kStart + 2500 * kMs));
  EXPECT_EQ(camera.tally().packets, 1U);
}

TEST(ControlFaults, AChangeOfWindowingDropsTheConnectionBeforeAnyStreamToo) {
  Camera camera({"windowing_drop:for=4"});
  EXPECT_EQ(camera.at(0), Commands::kAnswered);
  camera.faults.windowing_changed(kStart);
  EXPECT_EQ(camera.dropped, 1);
  EXPECT_EQ(camera.at(3999), Commands::kDropped);
  EXPECT_EQ(camera.at(4001), Commands::kAnswered);
}

}  // namespace
}  // namespace bolo::fakecam
