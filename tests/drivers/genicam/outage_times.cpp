// Measures how soon an outage is noticed and over: prints the median and the worst of some rounds of each kind, ms.
// Not a test: on a busy machine the times are those of the machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "src/core/clock.hpp"
#include "tests/drivers/genicam/fake_camera.hpp"

namespace bolo::genicam::test {
namespace {

constexpr int kRounds = 10;

struct Times {
  std::vector<double> noticed_ms;
  std::vector<double> lost_ms;
  std::vector<double> flows_ms;
};

bool until(const std::function<bool()>& condition) {
  const std::int64_t end_ns = monotonic_ns() + 20'000'000'000;
  while (!condition()) {
    if (monotonic_ns() > end_ns) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

void print(const char* what, std::vector<double> ms) {
  std::sort(ms.begin(), ms.end());
  if (!ms.empty()) std::printf("  %-22s median %7.0f  worst %7.0f ms\n", what, ms[ms.size() / 2], ms.back());
}

// `fault` breaks the camera, `repair` (may be empty) is done as soon as it counts as lost.
void measure(const char* name, const std::function<void(std::unique_ptr<FakeCamera>&)>& fault,
             const std::function<void(std::unique_ptr<FakeCamera>&)>& repair) {
  if (const std::string why = enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  Times times;
  for (int round = 0; round < kRounds; ++round) {
    auto fake = std::make_unique<FakeCamera>();
    GenicamSource source(options_for());
    const auto info = source.open();
    ASSERT_TRUE(info) << info.error().message;
    Collector collector(info->format);
    ASSERT_TRUE(source.start(collector.inlet()));
    ASSERT_TRUE(collector.wait_for(40));
    const std::int64_t fault_ns = monotonic_ns();
    const auto since_ms = [&] { return static_cast<double>(monotonic_ns() - fault_ns) * 1e-6; };
    fault(fake);
    ASSERT_TRUE(until([&] { return source.state() != SourceState::kStreaming; }));
    times.noticed_ms.push_back(since_ms());
    ASSERT_TRUE(until([&] { return source.state() == SourceState::kLost || source.reconnects() > 0; }));
    times.lost_ms.push_back(since_ms());
    const std::uint64_t before = collector.count();
    if (repair) repair(fake);
    const std::int64_t repaired_ns = monotonic_ns();
    ASSERT_TRUE(until([&] { return collector.count() > before; }));
    times.flows_ms.push_back(static_cast<double>(monotonic_ns() - (repair ? repaired_ns : fault_ns)) * 1e-6);
    source.stop();
  }
  std::printf("%s, %d rounds\n", name, kRounds);
  print("fault -> stalled", times.noticed_ms);
  print("fault -> lost", times.lost_ms);
  print(repair ? "restart -> flowing" : "fault -> flowing", times.flows_ms);
}

TEST(OutageTimes, KilledAndRestarted) {
  measure(
      "killed and restarted", [](auto& fake) { fake = nullptr; },
      [](auto& fake) { fake = std::make_unique<FakeCamera>(); });
}

TEST(OutageTimes, Rebooted) {
  measure(
      "rebooted at once",
      [](auto& fake) {
        fake = nullptr;
        fake = std::make_unique<FakeCamera>();
      },
      nullptr);
}

TEST(OutageTimes, ControlTaken) {
  measure(
      "control taken away", [](auto& fake) { fake->take_control_away(); }, nullptr);
}

TEST(OutageTimes, Stalled) {
  measure(
      "stream stalled", [](auto& fake) { fake->write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0); }, nullptr);
}

}  // namespace
}  // namespace bolo::genicam::test
