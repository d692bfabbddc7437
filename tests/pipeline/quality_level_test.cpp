#include "src/pipeline/quality_level.hpp"
#include "src/pipeline/solver_ladder.hpp"
#include "tests/motion/stream.hpp"

namespace bolo::pipeline::quality_level_test {

constexpr std::uint64_t kQueue = 64;

// Cost of a frame at each level, ms.
using Costs = std::array<double, kQualityLevels>;

// Simulated time: a camera that never waits, a queue, and one solver thread.
class Machine {
 public:
  explicit Machine(double rate_hz = 200.0) : period_ns_(std::llround(1e9 / rate_hz)), control_(kQueue, 1.0 / rate_hz) {}

  void run(const Costs& costs, double seconds) {
    const std::int64_t end_ns = now_ns_ + static_cast<std::int64_t>(seconds * 1e9);
    while (now_ns_ < end_ns) {
      arrive();
      if (waiting_ == 0) {
        now_ns_ = next_frame_ns_;
        continue;
      }
      most_waiting = std::max(most_waiting, --waiting_);
      const QualityLevel effort = control_.next(waiting_, now_ns_);
      efforts.push_back(effort);
      const auto cost_ns = static_cast<std::int64_t>(costs[static_cast<std::size_t>(effort)] * 1e6);
      control_.spent(cost_ns);
      now_ns_ += cost_ns;
    }
  }
  void stall(double seconds) { now_ns_ += static_cast<std::int64_t>(seconds * 1e9); }

  double share(QualityLevel effort) const {
    return static_cast<double>(std::count(efforts.begin(), efforts.end(), effort)) /
           static_cast<double>(efforts.size());
  }
  // Levels in the order of their first use.
  std::vector<QualityLevel> order() const {
    std::vector<QualityLevel> seen;
    for (const QualityLevel effort : efforts) {
      if (std::find(seen.begin(), seen.end(), effort) == seen.end()) seen.push_back(effort);
    }
    return seen;
  }

  std::vector<QualityLevel> efforts;
  std::uint64_t lost = 0;
  std::uint64_t most_waiting = 0;

 private:
  void arrive() {
    for (; next_frame_ns_ <= now_ns_; next_frame_ns_ += period_ns_) {
      waiting_ < kQueue ? ++waiting_ : ++lost;
    }
  }

  std::int64_t period_ns_;
  QualityControl control_;
  std::int64_t now_ns_ = 0;
  std::int64_t next_frame_ns_ = 0;
  std::uint64_t waiting_ = 0;
};

TEST(QualityControl, AFastMachineSpendsAllOnEveryFrame) {
  Machine machine;
  machine.run({4.9, 0.5, 0.1, 0.05}, 60.0);
  EXPECT_EQ(machine.share(QualityLevel::kFull), 1.0);
  EXPECT_EQ(machine.lost, 0U);
}

TEST(QualityControl, GoesDownInOrderAndNoFurtherThanNeeded) {
  const QualityLevel steps[] = {QualityLevel::kFull, QualityLevel::kReduced, QualityLevel::kInverse,
                                QualityLevel::kRaw};
  for (std::size_t affordable = 1; affordable < kQualityLevels; ++affordable) {
    Costs costs{9.0, 8.0, 7.0, 0.05};
    for (std::size_t i = affordable; i < kQualityLevels; ++i) costs[i] = 0.4;
    Machine machine;
    machine.run(costs, 120.0);
    EXPECT_EQ(machine.lost, 0U) << affordable;
    EXPECT_EQ(machine.order(), std::vector<QualityLevel>(steps, steps + affordable + 1));
  }
}

TEST(QualityControl, OnASlowMachineQualityDoesNotSwing) {
  Machine machine;
  machine.run({9.0, 2.0, 0.1, 0.05}, 120.0);
  machine.efforts.clear();
  machine.run({9.0, 2.0, 0.1, 0.05}, 120.0);
  EXPECT_GT(machine.share(QualityLevel::kReduced), 0.98) << "it tries the full effort now and then";
  EXPECT_GT(machine.share(QualityLevel::kFull), 0.0);
  EXPECT_EQ(machine.share(QualityLevel::kInverse), 0.0);
}

// A frame of a quarter of a second leaves fifty waiting: raw frames catch up, then the best affordable level follows.
TEST(QualityControl, ATrialThatFailsBadlyDoesNotHoldTheCheaperStepsBack) {
  Machine machine;
  machine.run({250.0, 0.5, 0.1, 0.05}, 300.0);
  machine.efforts.clear();
  machine.run({250.0, 0.5, 0.1, 0.05}, 300.0);
  EXPECT_GT(machine.share(QualityLevel::kReduced), 0.97);
  EXPECT_EQ(machine.lost, 0U);
}

// Slightly too slow: a few reduced frames make up for many full ones.
TEST(QualityControl, AMachineThatIsNearlyFastEnoughStaysNearlyFull) {
  Machine machine;
  machine.run({5.05, 1.5, 0.1, 0.05}, 120.0);
  EXPECT_GT(machine.share(QualityLevel::kFull), 0.9);
  EXPECT_EQ(machine.lost, 0U);
}

// Other programs preempt the thread for 60 ms, again and again.
TEST(QualityControl, ATrialThatFailsForWantOfAProcessorSaysNothingOfTheEffort) {
  const auto share_full = [](double full_ms) {
    Machine machine;
    for (int i = 0; i < 300; ++i) {
      machine.run({full_ms, 0.3, 0.1, 0.05}, 0.4);
      machine.stall(0.06);
    }
    return machine.share(QualityLevel::kFull);
  };
  EXPECT_GT(share_full(1.0), 0.7);
  EXPECT_LT(share_full(4.0), 0.2) << "which the thread would hardly manage if it ran";
}

TEST(QualityControl, WhatLastedTooLongIsNotForgottenAtOnceButInTheEnd) {
  Machine machine;
  machine.run({9.0, 2.0, 0.1, 0.05}, 300.0);  // the interval between trials has grown to 30 s
  machine.run({1.5, 0.5, 0.1, 0.05}, 31.0);
  EXPECT_EQ(machine.efforts.back(), QualityLevel::kFull);
  machine.stall(2.0 * 1e-9 * QualityControl::kTrialNs);
  machine.efforts.clear();
  machine.run({1.5, 0.5, 0.1, 0.05}, 1.0);
  EXPECT_EQ(machine.efforts.back(), QualityLevel::kFull) << "patience is as at the start again";
}

TEST(QualityControl, AfterAStallAllIsWellWithinHalfASecond) {
  Machine machine;
  machine.run({1.5, 0.5, 0.1, 0.05}, 1.0);
  machine.stall(0.3);
  EXPECT_EQ(machine.efforts.back(), QualityLevel::kFull);
  machine.efforts.clear();
  machine.run({1.5, 0.5, 0.1, 0.05}, 0.5);
  EXPECT_EQ(machine.efforts.front(), QualityLevel::kRaw) << "60 frames wait";
  EXPECT_EQ(machine.efforts.back(), QualityLevel::kFull);
  EXPECT_EQ(machine.lost, 0U);
}

// A fixed share of the queue would be 8 frames, a quarter of a second.
TEST(QualityControl, FramesOfASlowCameraDoNotGetOld) {
  Machine machine(30.0);
  machine.run({34.0, 9.0, 1.0, 0.5}, 120.0);
  EXPECT_LE(machine.most_waiting, 2U);
  EXPECT_GT(machine.share(QualityLevel::kFull), 0.9);
  EXPECT_EQ(machine.share(QualityLevel::kInverse), 0.0);
  QualityControl control(kQueue, 1.0 / 30.0);
  EXPECT_EQ(control.next(1, 0), QualityLevel::kFull);
  EXPECT_EQ(control.next(3, 0), QualityLevel::kInverse) << "100 ms";
  EXPECT_EQ(control.next(5, 0), QualityLevel::kRaw) << "167 ms";
}

TEST(QualityControl, AShortQueueHasItsStepsToo) {
  QualityControl control(4, 0.005);
  EXPECT_EQ(control.next(1, 0), QualityLevel::kFull) << "one that waits is no backlog";
  EXPECT_EQ(control.next(2, 0), QualityLevel::kReduced);
  EXPECT_EQ(control.next(3, 0), QualityLevel::kInverse);
  EXPECT_EQ(control.next(4, 0), QualityLevel::kRaw);
}

// In processor time, for a frame of a running stream; the first window costs more, as all of it is new.
TEST(SolverLadder, MeasuresAFrameOfAStreamThatFlows) {
  const deblur::Settings settings{.method = deblur::Method::kMotion};
  const StreamFormat format{.geometry = {320, 64}};
  auto ladder = must(SolverLadder::create(settings, format, PixelType::kUint16, 0.0, false));
  const double frame_s = ladder->measure(settings, format, PixelType::kUint16, 1).full_s;
  std::minstd_rand random(1);
  std::vector<std::vector<std::uint16_t>> planes(static_cast<std::size_t>(settings.window));
  std::vector<const void*> window;
  for (auto& plane : planes) {
    for (std::size_t i = 0; i < format.geometry.pixels(); ++i)
      plane.push_back(static_cast<std::uint16_t>(29000U + random() % 2000U));
    window.push_back(plane.data());
  }
  const std::clock_t begin = std::clock();
  ladder->at(QualityLevel::kFull).prepare({window, settings.window - 1, 0});
  const double first_s = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  EXPECT_GT(frame_s, 0.0);
  EXPECT_LT(frame_s, 0.7 * first_s) << "0.45 to 0.61 of it, by processor; a first window 0.8 and more";
}

TEST(SolverLadder, ReducedFramesAreNoFurtherFromTheTruthThanWhatIsCheaperStill) {
  namespace stream = deblur::testing;
  for (const double period_s : {0.005, 1.0 / 60.0}) {
    for (const auto method : {deblur::Method::kAdmm, deblur::Method::kMotion}) {
      const deblur::Settings settings{
          .method = method, .period_s = period_s, .auto_lambda = method != deblur::Method::kMotion};
      const int newest = settings.window - 1;
      stream::Stream pan(stream::pan(0.25, 0.0), 0.5, settings.window, 1, settings.tau_s / period_s);
      auto ladder =
          must(SolverLadder::create(settings, stream::format_of(PixelType::kUint16), PixelType::kFloat32, 0.0, true));
      const auto error = [&](QualityLevel level) {
        return stream::rmse(stream::solved(ladder->at(level), pan.window_ending_at(newest, 0)), pan.truth(newest));
      };
      const double reduced = error(QualityLevel::kReduced);
      const auto at = testing::Message() << deblur::name(method) << ", period " << period_s;
      EXPECT_LE(reduced, error(QualityLevel::kInverse)) << at;
      EXPECT_LT(reduced, pan.blurred_error(newest)) << at;
    }
  }
}

}  // namespace bolo::pipeline::quality_level_test
