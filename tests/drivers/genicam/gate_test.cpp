#include "drivers/genicam/gate.hpp"

#include <gtest/gtest.h>

#include <memory>

namespace bolo::genicam::gate_test {
namespace {

TEST(GateTest, IsShutUntilOpened) {
  Gate gate;
  EXPECT_FALSE(gate.enter());
  gate.open();
  EXPECT_TRUE(gate.enter());
  gate.leave();
  gate.shut();
  EXPECT_FALSE(gate.enter());
}

TEST(GateTest, ShutTwiceReturns) {
  Gate gate;
  gate.open();
  gate.shut();
  gate.shut();
}

// What the gate guards is destroyed right after shut(); the sanitizers see any use of it that is left.
TEST(GateTest, NobodyIsInsideAfterShut) {
  for (int round = 0; round < 100; ++round) {
    Gate gate;
    auto guarded = std::make_unique<int>(0);
    int* const plain = guarded.get();
    std::atomic<bool> end{false};
    std::atomic<int> entries{0};
    std::thread worker([&] {
      while (!end.load()) {
        if (!gate.enter()) continue;
        ++*plain;
        gate.leave();
        entries.fetch_add(1);
      }
    });
    gate.open();
    while (entries.load() < round % 7) std::this_thread::yield();
    gate.shut();
    const int seen = *guarded;
    std::this_thread::yield();
    EXPECT_EQ(*guarded, seen);
    guarded.reset();
    end.store(true);
    worker.join();
  }
}

}  // namespace
}  // namespace bolo::genicam::gate_test
