// Faults as text: what is read, what is refused and how, and when faults strike.
#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "drivers/fakecam/fault_script.hpp"

namespace bolo::fakecam::fault_script_test {
namespace {

constexpr std::int64_t kPeriodNs = 5'000'000;
constexpr std::int64_t kMs = 1'000'000;

Fault fault(std::string_view text) {
  auto parsed = parse_fault(text);
  EXPECT_TRUE(parsed.has_value()) << text << ": " << parsed.error().message;
  return parsed.value_or(Fault{fault_types().data(), {}});
}

std::string refusal(std::string_view text) {
  const auto parsed = parse_fault(text);
  EXPECT_FALSE(parsed.has_value()) << text;
  if (parsed) return {};
  EXPECT_EQ(parsed.error().exit_code(), 2) << text;
  return parsed.error().message;
}

TEST(FaultScript, KeysThatAreNotGivenStandAtTheirStandard) {
  const Fault loss = fault("loss:rate=0.05,at=1.5");
  EXPECT_EQ(loss.kind(), FaultKind::kLoss);
  EXPECT_EQ(loss.value("rate"), 0.05);
  EXPECT_EQ(loss.value("at"), 1.5);
  EXPECT_EQ(loss.value("for"), std::numeric_limits<double>::infinity());
  EXPECT_EQ(fault("reboot").value("for"), 1.0);
}

TEST(FaultScript, EveryFaultIsReadByItsNameAndItsTextIsReadBack) {
  std::set<std::string_view> names;
  for (const FaultType& type : fault_types()) {
    EXPECT_TRUE(names.insert(type.name).second) << type.name;
    Fault made{&type, {}};
    for (const FaultKey& key : type.keys) {
      if (key.key == "frames" || key.key == "every") continue;  // exclude others
      made.values.emplace(key.key, key.low > 0.0 ? key.low : key.high);
    }
    const Fault read = fault(fault_text(made));
    EXPECT_EQ(read.type, &type);
    EXPECT_EQ(read.values, made.values);
  }
}

TEST(FaultScript, SaysWhatIsWrongInOneLine) {
  EXPECT_EQ(refusal("los:rate=1"),
            "there is no fault 'los'; did you mean 'loss'? (bolo fakecam --list-faults shows all)");
  EXPECT_EQ(refusal("loss:rat=1"), "fault loss: there is no key 'rat'; did you mean 'rate'?");
  EXPECT_EQ(refusal("loss:rate=2"), "fault loss: rate=2: expected 0 to 1");
  EXPECT_EQ(refusal("loss:rate=nan"), "fault loss: rate=nan: expected a number");
  EXPECT_EQ(refusal("loss:rate="), "fault loss: rate=: expected a number");
  EXPECT_EQ(refusal("loss:rate=0.1x"), "fault loss: rate=0.1x: expected a number");
  EXPECT_EQ(refusal("loss:"), "fault loss: '': expected key=value");
  EXPECT_EQ(refusal("loss:rate=0.1,"), "fault loss: '': expected key=value");
  EXPECT_EQ(refusal("loss:rate=0.1,rate=0.2"), "fault loss: rate is given twice");
  EXPECT_EQ(refusal("id_gap:ids=1.5"), "fault id_gap: ids=1.5: expected a whole number from 1 to 30000");
  EXPECT_EQ(refusal("stall:for=1,frames=4"), "fault stall: give for or frames, not both");
  EXPECT_EQ(refusal("stall:for=1,every=0.5"), "fault stall: every=0.5 must be longer than a strike lasts: 1; set for");
  EXPECT_EQ(refusal("loss:every=1"), "fault loss: every=1 must be longer than a strike lasts: for ever; set for");
  EXPECT_NE(refusal(""), "");
}

TEST(FaultSchedule, LastsFromAtForItsTime) {
  const Schedule schedule = schedule_of(fault("stall:at=1,for=0.5"), kPeriodNs);
  EXPECT_FALSE(schedule.lasts(1000 * kMs - 1));
  EXPECT_TRUE(schedule.lasts(1000 * kMs));
  EXPECT_TRUE(schedule.lasts(1500 * kMs - 1));
  EXPECT_FALSE(schedule.lasts(1500 * kMs));
}

TEST(FaultSchedule, ComesAgain) {
  const Schedule schedule = schedule_of(fault("stall:at=1,for=0.5,every=2"), kPeriodNs);
  EXPECT_EQ(schedule.begun(999 * kMs), 0U);
  EXPECT_EQ(schedule.begun(2999 * kMs), 1U);
  EXPECT_EQ(schedule.begun(3000 * kMs), 2U);
  EXPECT_EQ(schedule.ended(3499 * kMs), 1U);
  EXPECT_EQ(schedule.ended(3500 * kMs), 2U);
  EXPECT_FALSE(schedule.lasts(2000 * kMs));
  EXPECT_TRUE(schedule.lasts(3100 * kMs));
}

TEST(FaultSchedule, WithoutAnEndItLastsForEver) {
  const Schedule schedule = schedule_of(fault("loss:at=1"), kPeriodNs);
  EXPECT_TRUE(schedule.lasts(1'000'000'000 * kMs));
  EXPECT_EQ(schedule.begun(1'000'000'000 * kMs), 1U);
}

TEST(FaultSchedule, FramesAreCountedExactlyWhateverTheirTimesAreRoundedTo) {
  for (const std::int64_t period : {kPeriodNs, std::int64_t{33'333'333}, std::int64_t{3'333'333}}) {
    for (const char* text : {"stall:at=0.1,frames=7", "stall:at=0.1003,frames=7"}) {
      const Schedule schedule = frame_schedule_of(fault(text), period);
      int hit = 0;
      for (std::int64_t k = 0; k < 1000; ++k) {
        const std::int64_t rounding = k % 3 - 1;
        if (schedule.lasts(k * period + rounding)) ++hit;
      }
      EXPECT_EQ(hit, 7) << text << " at " << period;
    }
  }
}

}  // namespace
}  // namespace bolo::fakecam::fault_script_test
