// Scripts and frames for the tests of single faults.
#pragma once

#include <gtest/gtest.h>

#include <initializer_list>
#include <string_view>

#include "drivers/fakecam/fault_tally.hpp"
#include "drivers/fakecam/frame_ring.hpp"

namespace bolo::fakecam::test {

inline constexpr std::int64_t kPeriodNs = 5'000'000;

inline FaultScript script_of(std::initializer_list<std::string_view> texts) {
  FaultScript script;
  for (const std::string_view text : texts) {
    auto fault = parse_fault(text);
    EXPECT_TRUE(fault.has_value()) << fault.error().message;
    if (fault) script.push_back(std::move(*fault));
  }
  return script;
}

// The frame in this place of the stream.
inline WireFrame frame_at(std::uint64_t sequence) {
  WireFrame frame;
  frame.sequence = sequence;
  frame.due_ns = static_cast<std::int64_t>(sequence) * kPeriodNs;
  return frame;
}

}  // namespace bolo::fakecam::test
