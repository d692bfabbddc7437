// The C interface of libbolo-client, as other programs use it: one writer, driven by the test, and several handles.
#include "tests/drivers/shm/client_rig.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/refusal.hpp"

namespace bolo::shm::client_test {

class ClientTest : public testing::Test {
 protected:
  ClientTest() : name_(unique_name(testing::UnitTest::GetInstance()->current_test_info()->name())) {}

  void SetUp() override { write_anew({33, 7}); }
  void write_anew(Geometry geometry) {
    writer_ = nullptr;
    writer_ = std::make_unique<Writer>(name_, geometry);
    ASSERT_TRUE(writer_->open());
  }
  Client open() const {
    Client client = open_client(name_);
    if (!client) throw std::runtime_error(bolo_client_error(nullptr));
    return client;
  }
  void publish(int count) {
    for (int i = 0; i < count; ++i) writer_->publish();
  }

  std::string name_;
  std::unique_ptr<Writer> writer_;
  bolo_client_frame frame_{};
};

bool intact(const bolo_client_frame& frame, std::uint64_t number) {
  if (frame.number != number || frame.frame_id != 2 * number) return false;
  for (std::size_t i = 0; i < std::size_t{frame.width} * frame.height; ++i) {
    if (frame.raw[i] != pattern(number, 0, i) || frame.deblurred[i] != pattern(number, 1, i)) return false;
  }
  return bolo_client_valid(&frame) == 1;
}

TEST_F(ClientTest, InfoSaysWhatTheStreamIs) {
  const Client client = open();
  const auto* info = bolo_client_get_info(client.get());
  EXPECT_EQ(info->width, 33U);
  EXPECT_EQ(info->height, 7U);
  EXPECT_EQ(info->unit, std::uint32_t{BOLO_UNIT_KELVIN});
  EXPECT_DOUBLE_EQ(info->scale, 0.01);
  EXPECT_DOUBLE_EQ(info->offset, 5.0);
  EXPECT_DOUBLE_EQ(info->frame_period_s, 0.005);
  EXPECT_STREQ(info->camera_model, "Model");
  EXPECT_STREQ(info->camera_serial, "1234");
  EXPECT_STREQ(info->solver, "admm");
  EXPECT_EQ(info->writer_pid, static_cast<std::uint32_t>(getpid()));
  EXPECT_EQ(info->restarts, 0U);
  ASSERT_NE(info->settings, nullptr);
  EXPECT_EQ(info->settings->method, std::uint32_t{BOLO_METHOD_ADMM});
  EXPECT_STREQ(info->control_socket, "");
}

TEST_F(ClientTest, ThePeriodIsThatWhichTheWriterFoundLast) {
  const Client client = open();
  const bolo_client_point points[] = {{3, 2}, {4, 2}, {5, 2}};
  float before[3];
  float after[3];
  writer_->stats.period_s.set(0.005);
  publish(40);
  ASSERT_EQ(bolo_client_points(client.get(), 30, points, 3, before), BOLO_CLIENT_OK);
  writer_->stats.period_s.set(0.0055);
  publish(1);
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
  EXPECT_DOUBLE_EQ(bolo_client_get_info(client.get())->frame_period_s, 0.0055);
  ASSERT_EQ(bolo_client_points(client.get(), 30, points, 3, after), BOLO_CLIENT_OK);
  EXPECT_FALSE(std::ranges::equal(before, after)) << "solved with another period";
}

TEST_F(ClientTest, FramesCarryTheirMotion) {
  writer_ = std::make_unique<Writer>(name_, Geometry{33, 20});
  writer_->format.motion = true;
  ASSERT_TRUE(writer_->open());
  const Client client = open();
  for (std::uint64_t n = 0; n < 80; ++n) {
    publish(1);
    ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
    ASSERT_TRUE(intact(frame_, n));
    bolo_shm_motion whole{};
    std::vector<bolo_shm_block_motion> blocks(15);
    const int copied = bolo_client_copy_motion(&frame_, &whole, blocks.data());
    ASSERT_EQ(copied, moves(n) ? BOLO_CLIENT_OK : BOLO_CLIENT_NO_MOTION) << n;
    ASSERT_EQ(frame_.motion_across * frame_.motion_down, moves(n) ? 15U : 0U);
    if (!moves(n)) {
      EXPECT_EQ(frame_.motion, nullptr);
      EXPECT_EQ(frame_.motion_blocks, nullptr);
      continue;
    }
    EXPECT_EQ(frame_.motion->affine[0], static_cast<double>(n));
    EXPECT_EQ(whole.affine[5], 5.0);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      ASSERT_EQ(frame_.motion_blocks[i].y, motion_pattern(n, i, 1)) << n;
      ASSERT_EQ(blocks[i].confidence, motion_pattern(n, i, 2)) << n;
    }
    EXPECT_EQ(bolo_client_copy_motion(&frame_, nullptr, nullptr), BOLO_CLIENT_OK);
  }
  const bolo_client_frame old = frame_;
  publish(80);
  std::vector<bolo_shm_block_motion> blocks(15);
  EXPECT_EQ(bolo_client_copy_motion(&old, nullptr, blocks.data()), BOLO_CLIENT_OVERWRITTEN);
  EXPECT_EQ(bolo_client_copy_motion(nullptr, nullptr, blocks.data()), BOLO_CLIENT_BAD_ARGUMENT);
}

TEST_F(ClientTest, FramesComeInOrderInPlace) {
  publish(3);
  const Client client = open();
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
  EXPECT_TRUE(intact(frame_, 2)) << "a stream begins with its newest frame";
  EXPECT_EQ(frame_.missed, 0U);
  EXPECT_EQ(frame_.motion_across, 0U);
  EXPECT_EQ(bolo_client_copy_motion(&frame_, nullptr, nullptr), BOLO_CLIENT_NO_MOTION);
  EXPECT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_TIMEOUT);
  EXPECT_EQ(frame_.number, 2U) << "without a frame the structure stays as it was";
  publish(2);
  for (std::uint64_t n = 3; n < 5; ++n) {
    ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
    EXPECT_TRUE(intact(frame_, n));
    EXPECT_EQ(frame_.missed, 0U);
    EXPECT_EQ(frame_.camera_ns, static_cast<std::int64_t>(n) * 5'000'000);
    EXPECT_EQ(frame_.receive_ns, static_cast<std::int64_t>(1000 + n));
    EXPECT_EQ(frame_.publish_ns, static_cast<std::int64_t>(2000 + n));
    EXPECT_EQ(frame_.utc_ns, utc_of(n));
    EXPECT_EQ(frame_.utc_uncertainty_us, 1501U) << "rounded up";
    EXPECT_EQ(frame_.flags, 0U);
  }
  publish(1);
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
  EXPECT_EQ(frame_.flags, std::uint32_t{BOLO_FLAG_GAP});
}

TEST_F(ClientTest, TheLatestFrameCountsThoseBeforeItAsMissed) {
  const Client client = open();
  publish(10);
  ASSERT_EQ(bolo_client_latest(client.get(), 0, &frame_), BOLO_CLIENT_OK);
  EXPECT_TRUE(intact(frame_, 9));
  EXPECT_EQ(frame_.missed, 9U);
  EXPECT_EQ(bolo_client_latest(client.get(), 0, &frame_), BOLO_CLIENT_TIMEOUT);
}

TEST_F(ClientTest, AReaderThatFellBehindGoesOnInTheRingsMiddle) {
  const Client client = open();
  const std::uint64_t slots = bolo_client_get_info(client.get())->slot_count;
  publish(static_cast<int>(3 * slots));
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
  EXPECT_TRUE(intact(frame_, frame_.number));
  EXPECT_EQ(frame_.missed, frame_.number);
  EXPECT_GT(frame_.number, 2 * slots + slots / 4);
  EXPECT_LT(frame_.number, 3 * slots - slots / 4);
}

TEST_F(ClientTest, AFrameIsNoLongerValidOnceTheRingHasComeRound) {
  publish(1);
  const Client client = open();
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
  std::vector<std::uint16_t> raw(frame_.width * frame_.height);
  std::vector<std::uint16_t> deblurred(raw.size());
  ASSERT_EQ(bolo_client_copy(&frame_, raw.data(), deblurred.data()), BOLO_CLIENT_OK);
  for (std::size_t i = 0; i < raw.size(); ++i) {
    ASSERT_EQ(raw[i], pattern(0, 0, i));
    ASSERT_EQ(deblurred[i], pattern(0, 1, i));
  }
  publish(static_cast<int>(bolo_client_get_info(client.get())->slot_count) - 1);
  EXPECT_EQ(bolo_client_valid(&frame_), 1);
  publish(1);
  EXPECT_EQ(bolo_client_valid(&frame_), 0);
  EXPECT_EQ(bolo_client_copy(&frame_, raw.data(), nullptr), BOLO_CLIENT_OVERWRITTEN);
  EXPECT_EQ(bolo_client_valid(nullptr), 0);
  const bolo_client_frame none{};
  EXPECT_EQ(bolo_client_valid(&none), 0);
  EXPECT_EQ(bolo_client_copy(&none, nullptr, nullptr), BOLO_CLIENT_BAD_ARGUMENT);
}

TEST_F(ClientTest, ValuesBecomeKelvinAndCountsDoNot) {
  Client client = open();
  const std::uint16_t values[] = {0, 1, 29'500, 65'535};
  float kelvin[4] = {};
  ASSERT_EQ(bolo_client_kelvin(client.get(), values, 4, kelvin), BOLO_CLIENT_OK);
  for (int i = 0; i < 4; ++i) EXPECT_FLOAT_EQ(kelvin[i], static_cast<float>(0.01 * values[i] + 5.0));
  client = nullptr;
  writer_->sink.close();
  writer_->format.source.format.scale.unit = Unit::kCount;
  ASSERT_TRUE(writer_->open());
  client = open_client(name_);
  ASSERT_TRUE(client);
  EXPECT_EQ(bolo_client_kelvin(client.get(), values, 4, kelvin), BOLO_CLIENT_UNSUPPORTED);
  expect_parts(bolo_client_error(client.get()), {"in counts"});
}

TEST_F(ClientTest, StateTellsLossesAndLife) {
  const Client client = open();
  writer_->inlet.count_loss(LossCause::kMissing, 3);
  writer_->inlet.count_loss(LossCause::kOutOfOrder, 2);
  writer_->stats.gap_frames.add(6);
  publish(2);
  const auto* state = bolo_client_get_state(client.get());
  EXPECT_EQ(state->alive, 1U);
  EXPECT_EQ(state->published, 2U);
  EXPECT_EQ(state->lost[static_cast<std::size_t>(LossCause::kMissing)], 3U);
  EXPECT_EQ(state->lost_frames, 5U);
  EXPECT_EQ(state->gap_frames, 6U);
  EXPECT_GE(state->heartbeat_age_ns, 0);
  ASSERT_NE(state->camera, nullptr);
  EXPECT_EQ(state->camera->state, std::uint64_t{BOLO_CAMERA_IDLE});
  writer_ = nullptr;
  EXPECT_EQ(bolo_client_get_state(client.get())->alive, 0U);
}

TEST_F(ClientTest, ARestartIsToldOnceAndFollowed) {
  const Client client = open();
  publish(2);
  write_anew({16, 4});
  publish(3);
  for (std::uint64_t n = 0; n < 2; ++n) {
    ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK) << "what is left of the old ring comes first";
    EXPECT_TRUE(intact(frame_, n));
  }
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_RESTARTED);
  EXPECT_EQ(bolo_client_get_info(client.get())->width, 16U);
  EXPECT_EQ(bolo_client_get_info(client.get())->height, 4U);
  EXPECT_EQ(bolo_client_get_info(client.get())->restarts, 1U);
  for (std::uint64_t n = 0; n < 3; ++n) {
    ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
    EXPECT_TRUE(intact(frame_, n)) << "none of the new ring is left out";
    EXPECT_EQ(frame_.width, 16U);
  }
}

TEST_F(ClientTest, AnEndIsToldUntilAnotherWriterComes) {
  const Client client = open();
  writer_ = nullptr;
  EXPECT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_ENDED);
  EXPECT_EQ(bolo_client_next(client.get(), 5, &frame_), BOLO_CLIENT_ENDED);
  expect_parts(bolo_client_error(client.get()), {"its writer has ended"});
  std::jthread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    write_anew({33, 7});
    publish(1);
  });
  EXPECT_EQ(bolo_client_next(client.get(), 60'000, &frame_), BOLO_CLIENT_RESTARTED);
  EXPECT_EQ(bolo_client_next(client.get(), 60'000, &frame_), BOLO_CLIENT_OK);
}

TEST_F(ClientTest, AHoldKeepsOldFramesReadableAcrossARestart) {
  publish(1);
  Client client = open();
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame_), BOLO_CLIENT_OK);
  bolo_client_hold* hold = bolo_client_hold_new(client.get());
  ASSERT_NE(hold, nullptr);
  write_anew({16, 4});
  bolo_client_frame other{};
  ASSERT_EQ(bolo_client_next(client.get(), 0, &other), BOLO_CLIENT_RESTARTED);
  EXPECT_TRUE(intact(frame_, 0));
  client = nullptr;
  EXPECT_TRUE(intact(frame_, 0)) << "and after the handle's end";
  bolo_client_hold_free(hold);
}

TEST_F(ClientTest, ManyHandlesReadAtTheSameTime) {
  constexpr int kEnough = 50;
  std::atomic<int> reading{4};
  std::atomic<int> torn{0};
  const auto read = [&] {
    const Client client = open_client(name_);
    bolo_client_frame frame{};
    std::vector<std::uint16_t> raw(std::size_t{33} * 7);
    for (int good = 0; client && good < kEnough;) {
      if (bolo_client_next(client.get(), 60'000, &frame) != BOLO_CLIENT_OK) break;
      if (bolo_client_copy(&frame, raw.data(), nullptr) != BOLO_CLIENT_OK) continue;
      for (std::size_t i = 0; i < raw.size(); ++i) torn += raw[i] != pattern(frame.number, 0, i) ? 1 : 0;
      ++good;
    }
    --reading;
  };
  std::vector<std::jthread> threads;
  for (int i = 0; i < 4; ++i) threads.emplace_back(read);
  while (reading > 0) {
    publish(1);
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  EXPECT_EQ(torn, 0);
}

TEST_F(ClientTest, WrongArgumentsAreAnswersNotCrashes) {
  const Client client = open();
  bolo_client* none = client.get();
  EXPECT_EQ(bolo_client_open(nullptr, 0, &none), BOLO_CLIENT_BAD_ARGUMENT);
  EXPECT_EQ(none, nullptr);
  EXPECT_EQ(bolo_client_open("x", 0, nullptr), BOLO_CLIENT_BAD_ARGUMENT);
  EXPECT_EQ(bolo_client_open("a/b", 0, &none), BOLO_CLIENT_BAD_ARGUMENT);
  expect_parts(bolo_client_error(nullptr), {"is no name"});
  EXPECT_EQ(bolo_client_open("no-such-camera", 0, &none), BOLO_CLIENT_ABSENT);
  expect_parts(bolo_client_error(nullptr), {"no shared memory named 'no-such-camera'"});
  EXPECT_EQ(bolo_client_next(nullptr, 0, &frame_), BOLO_CLIENT_BAD_ARGUMENT);
  EXPECT_EQ(bolo_client_next(client.get(), 0, nullptr), BOLO_CLIENT_BAD_ARGUMENT);
  EXPECT_EQ(bolo_client_latest(client.get(), 0, nullptr), BOLO_CLIENT_BAD_ARGUMENT);
  EXPECT_EQ(bolo_client_kelvin(client.get(), nullptr, 1, nullptr), BOLO_CLIENT_BAD_ARGUMENT);
  EXPECT_EQ(bolo_client_points(client.get(), 0, nullptr, 1, nullptr), BOLO_CLIENT_BAD_ARGUMENT);
  float value = 0.0F;
  const bolo_client_point outside{33, 0};
  EXPECT_EQ(bolo_client_points(client.get(), 0, &outside, 1, &value), BOLO_CLIENT_BAD_ARGUMENT);
  expect_parts(bolo_client_error(client.get()), {"(33, 0) is not inside the frame of 33x7"});
  EXPECT_EQ(bolo_client_points(client.get(), 0, nullptr, 0, nullptr), BOLO_CLIENT_OK) << "no points, nothing to do";
  const bolo_client_point inside{32, 6};
  EXPECT_EQ(bolo_client_points(client.get(), 0, &inside, 1, &value), BOLO_CLIENT_NOT_YET);
  writer_->flags = kFlagWarmUp;
  publish(1);
  EXPECT_EQ(bolo_client_points(client.get(), 0, &inside, 1, &value), BOLO_CLIENT_WARM_UP);
  EXPECT_EQ(bolo_client_hold_new(nullptr), nullptr);
  bolo_client_hold_free(nullptr);
  bolo_client_close(nullptr);
}

TEST_F(ClientTest, StreamsAreListedAndCutToFit) {
  std::vector<char> text(1 << 16);
  const int all = bolo_client_streams(text.data(), text.size());
  ASSERT_GT(all, 0);
  expect_parts(std::string("\n") + text.data(), {"\n" + name_ + "\n"});
  char few[4] = {'x', 'x', 'x', 'x'};
  EXPECT_GT(bolo_client_streams(few, sizeof(few)), 4);
  EXPECT_EQ(few[3], '\0');
  EXPECT_GT(bolo_client_streams(nullptr, 0), 0);
  EXPECT_EQ(bolo_client_streams(nullptr, 1), BOLO_CLIENT_BAD_ARGUMENT);
}

// Dynamic symbols, as a linker sees them.
TEST(ClientLibrary, ExportsItsFunctionsAndNothingElse) {
  FILE* symbols = popen("nm -D --defined-only " BOLO_CLIENT_LIBRARY, "r");
  ASSERT_NE(symbols, nullptr);
  char address[64];
  char kind[8];
  char symbol[256];
  int functions = 0;
  while (std::fscanf(symbols, "%63s %7s %255s", address, kind, symbol) == 3) {
    const std::string name = symbol;
    if (name == "BOLO_CLIENT_0") continue;  // the version node
    EXPECT_EQ(name.rfind("bolo_client_", 0), 0U) << name;
    expect_parts(name, {"@@BOLO_CLIENT_0"});
    ++functions;
  }
  EXPECT_EQ(pclose(symbols), 0);
  EXPECT_EQ(functions, 16);
}

}  // namespace bolo::shm::client_test
