// The arithmetic of a cluster, in cases that can be done by hand.
#include "tools/bench/cluster_model.hpp"

#include <gtest/gtest.h>

namespace bolo::tools {
namespace {

// A frame takes 2 ms and 1 MB; nothing else costs anything.
PieceCosts plain() {
  PieceCosts costs;
  costs.deblur_s = 2e-3;
  costs.raw_bytes = 4e5;
  costs.sharp_bytes = 6e5;
  return costs;
}

ClusterTask ten_hours() { return {.hours = 10.0, .capture_hours = 1.0, .rate_hz = 200.0, .block_frames = 0.0}; }

ClusterMachines boundless(double machines) {
  return {.machines = machines, .cores = 1.0, .network_gb_s = 1e9, .storage_gb_s = 1e9, .price_core_hour = 0.5};
}

TEST(ClusterModel, OneCoreTakesTheSumOfAllFrames) {
  const ClusterTime time = calculate(plain(), ten_hours(), boundless(1));
  EXPECT_NEAR(time.seconds, 10 * 720'000 * 2e-3, 1e-6);
  EXPECT_NEAR(time.speed_up, 1.0, 1e-12);
  EXPECT_NEAR(time.efficiency, 1.0, 1e-12);
  EXPECT_EQ(time.limit, "compute");
  EXPECT_NEAR(time.price_per_hour, 0.4 * 0.5, 1e-12) << "0.4 core hours";
  EXPECT_NEAR(time.terabytes, 7.2, 1e-9);
}

TEST(ClusterModel, WholeCapturesAreSharedByNoMoreThanThereAre) {
  EXPECT_NEAR(calculate(plain(), ten_hours(), boundless(10)).speed_up, 10.0, 1e-9);
  EXPECT_NEAR(calculate(plain(), ten_hours(), boundless(100)).speed_up, 10.0, 1e-9);
  EXPECT_NEAR(calculate(plain(), ten_hours(), boundless(7)).speed_up, 5.0, 1e-9) << "three wait for the last three";
}

TEST(ClusterModel, BlocksAreSharedByMoreAndPutTogetherAtTheEnd) {
  ClusterTask task = ten_hours();
  task.block_frames = 7200.0;  // 100 a capture
  EXPECT_NEAR(calculate(plain(), task, boundless(100)).speed_up, 100.0, 1e-9);
  PieceCosts costs = plain();
  costs.together_s = 1e-4;
  const ClusterTime time = calculate(costs, task, boundless(100));
  EXPECT_NEAR(time.together_s, 72.0, 1e-9) << "each capture by a rank of its own";
  EXPECT_NEAR(time.seconds, 144.0 + 72.0, 1e-9);
  EXPECT_NEAR(time.terabytes, 7.2e6 * (4e5 + 3 * 6e5) / 1e12, 1e-9) << "blocks are written, read, and written again";
}

TEST(ClusterModel, AWalkIsAChainThatMachinesDoNotShorten) {
  ClusterTask task = ten_hours();
  task.block_frames = 7200.0;
  PieceCosts costs = plain();
  costs.walk_s = 2e-4;
  const ClusterTime time = calculate(costs, task, boundless(10'000));
  EXPECT_EQ(time.limit, "walk");
  EXPECT_NEAR(time.seconds, 720'000 * 2e-4 + 7200 * 2e-3, 1e-6);
}

TEST(ClusterModel, StorageAndNetworksBoundWhatIsMoved) {
  ClusterMachines machines = boundless(4);
  machines.network_gb_s = 0.1;
  ClusterTime time = calculate(plain(), ten_hours(), machines);
  EXPECT_EQ(time.limit, "storage");
  EXPECT_NEAR(time.seconds, 7200.0 / 0.4, 1e-6);
  machines.storage_gb_s = 0.2;
  time = calculate(plain(), ten_hours(), machines);
  EXPECT_NEAR(time.seconds, 7200.0 / 0.2, 1e-6) << "all networks together could do more";
}

TEST(ClusterModel, RankZeroHandsOutOnePieceAfterTheOther) {
  ClusterTask task = ten_hours();
  task.block_frames = 1.0;
  PieceCosts costs = plain();
  costs.deblur_s = 1e-9;
  costs.word_s = 1e-6;
  const ClusterTime time = calculate(costs, task, boundless(1000));
  EXPECT_EQ(time.limit, "rank 0");
  EXPECT_NEAR(time.seconds, (7.2e6 + 10) * 1e-6, 1e-6) << "and ten outputs";
}

TEST(ClusterModel, SmallPiecesCostMore) {
  PieceCosts costs = plain();
  costs.piece_s = 0.1;
  ClusterTask task = ten_hours();
  task.block_frames = 200.0;
  const ClusterTime time = calculate(costs, task, boundless(1));
  EXPECT_NEAR(time.seconds, 7.2e6 * 2e-3 + 36'000 * 0.1, 1e-3);
}

}  // namespace
}  // namespace bolo::tools
