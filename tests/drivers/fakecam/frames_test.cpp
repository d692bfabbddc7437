// The counts, ids and times that frames are sent with.
#include "drivers/fakecam/frames.hpp"
#include "tests/test.hpp"

namespace bolo::fakecam::frames_test {

constexpr LinearScale kKelvin{Unit::kKelvin, 1.0, 0.0};

// A row of stored values as it is sent.
template <typename Value>
std::vector<std::uint16_t> sent(const std::vector<Value>& row, LinearScale scale, IrFormat ir_format) {
  const int width = static_cast<int>(row.size());
  const PixelType type = std::is_same_v<Value, float> ? PixelType::kFloat32 : PixelType::kUint16;
  std::vector<std::uint16_t> counts(row.size());
  CountConverter({{width, 1}, type, scale}, ir_format, {0, 0, width, 1}).convert(row.data(), counts.data());
  return counts;
}

using Counts = std::vector<std::uint16_t>;

TEST(CountConverter, KelvinFloatsBecomeRoundedCountsOf10mK) {
  const std::vector<float> kelvin{300.0F, 300.004F, 300.006F, 0.0F};
  EXPECT_EQ(sent(kelvin, kKelvin, IrFormat::kTemperatureLinear10mK), (Counts{30000, 30000, 30001, 0}));
}

TEST(CountConverter, ClampsWhatSixteenBitsCantHold) {
  const std::vector<float> kelvin{700.0F, -5.0F, std::numeric_limits<float>::quiet_NaN(),
                                  std::numeric_limits<float>::infinity()};
  EXPECT_EQ(sent(kelvin, kKelvin, IrFormat::kTemperatureLinear10mK), (Counts{65535, 0, 0, 65535}));
}

TEST(CountConverter, RadiometricCountsLeadBackToTheTemperature) {
  for (const float kelvin : {250.0F, 300.0F, 400.0F}) {
    const std::uint16_t count = sent(std::vector<float>{kelvin}, kKelvin, IrFormat::kRadiometric).front();
    const double radiance = (count - kPlanck.j0) / kPlanck.j1;
    EXPECT_NEAR(kPlanck.b / std::log(kPlanck.r / radiance + kPlanck.f), static_cast<double>(kelvin), 0.02);
  }
}

using Ids = std::vector<std::uint64_t>;
using Times = std::vector<double>;

TEST(Timeline, BlockIdsSkipZeroAndWrapAfter65535) {
  EXPECT_EQ(block_id_of(0), 1);
  EXPECT_EQ(block_id_of(65533), 65534);
  EXPECT_EQ(block_id_of(65534), 65535);
  EXPECT_EQ(block_id_of(65535), 1);
  EXPECT_EQ(block_id_of(std::uint64_t{65535} * 1000 + 4), 5);
}

TEST(Timeline, KeepsTheCapturesIdsAndTimesWithAllTheirJumps) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.0051, 1.02}, 0.005, 0.0);
  EXPECT_EQ(timeline.at(0).frame_id, 7U);
  EXPECT_EQ(timeline.at(1).timestamp_ns, 1'005'100'000U);
  EXPECT_EQ(timeline.at(2).frame_id, 11U);
  EXPECT_EQ(timeline.at(2).timestamp_ns, 1'020'000'000U);
}

TEST(Timeline, SeamOfALoopIsOneFrameWide) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.005, 1.02}, 0.005, 0.0);
  const auto last = timeline.at(2);
  const auto first = timeline.at(3);
  EXPECT_EQ(first.index, 0U);
  EXPECT_EQ(first.frame_id, last.frame_id + 1);
  EXPECT_EQ(first.timestamp_ns, last.timestamp_ns + 5'000'000);
  EXPECT_EQ(timeline.at(3'000'000).frame_id, 7U + 1'000'000U * 5U);
}

TEST(Timeline, AnotherRateSpacesTimesEvenlyLostFramesIncluded) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.0051, 1.02}, 0.005, 50.0);
  EXPECT_EQ(timeline.at(1).timestamp_ns - timeline.at(0).timestamp_ns, 20'000'000U);
  EXPECT_EQ(timeline.at(2).timestamp_ns - timeline.at(1).timestamp_ns, 60'000'000U);
  EXPECT_EQ(timeline.at(3).timestamp_ns - timeline.at(2).timestamp_ns, 20'000'000U);
}

void write_one(FrameRing& ring, std::uint16_t id) {
  WireFrame* frame = ring.begin_write();
  ASSERT_NE(frame, nullptr);
  frame->block.block_id = id;
  frame->counts.assign(frame->counts.size(), id);
  ring.end_write();
}

void send_one(FrameRing& ring, std::uint16_t expected) {
  const WireFrame* frame = ring.begin_send();
  ASSERT_NE(frame, nullptr);
  EXPECT_EQ(frame->block.block_id, expected);
  ring.end_send();
}

TEST(FrameRing, APinHoldsTheWriterBackAndASlotThatIsWrittenIsNotFound) {
  FrameRing ring(1, 1, 4);
  for (std::uint16_t id = 1; id <= 2; ++id) {
    write_one(ring, id);
    send_one(ring, id);
  }
  std::atomic<bool> written{false};
  std::thread writer;
  {
    const auto pin = ring.find(1);
    ASSERT_NE(pin.frame(), nullptr);
    writer = std::thread([&] {
      write_one(ring, 3);
      written = true;
    });
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_FALSE(written);
    EXPECT_EQ(pin.frame()->counts.front(), 1);
  }
  writer.join();
  EXPECT_EQ(ring.find(1).frame(), nullptr);
}

TEST(FrameRing, ThreeThreadsSeeOnlyWholeFrames) {
  FrameRing ring(4, 4, 64);
  constexpr std::uint16_t kFrames = 2000;
  std::thread writer([&] {
    for (std::uint16_t id = 1; id <= kFrames; ++id) write_one(ring, id);
    ring.finish();
  });
  std::atomic<bool> done{false};
  std::thread finder([&] {
    for (std::uint16_t id = 1; !done; id = static_cast<std::uint16_t>(id % kFrames + 1)) {
      const auto pin = ring.find(id);
      if (pin.frame() == nullptr) continue;
      for (const auto value : pin.frame()->counts) ASSERT_EQ(value, id);
    }
  });
  std::uint16_t expected = 0;
  while (const WireFrame* frame = ring.begin_send()) {
    EXPECT_EQ(frame->counts.back(), ++expected);
    ring.end_send();
  }
  done = true;
  writer.join();
  finder.join();
  EXPECT_EQ(expected, kFrames);
}

}  // namespace bolo::fakecam::frames_test
