// The view's buffers: newest frame and traces of pixels, also across restarts of the writer.
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/tools/program.hpp"
#include "tools/view/live_stream.hpp"

namespace bolo::view::view_stream_test {

FrameHead head_of(const std::string& frame) {
  FrameHead head;
  std::memcpy(&head, frame.data(), sizeof head);
  return head;
}

std::uint16_t value_at(const std::string& frame, std::size_t plane, std::size_t pixel) {
  const FrameHead head = head_of(frame);
  const std::size_t place = plane * head.width * head.height + pixel;
  std::uint16_t value = 0;
  std::memcpy(&value, frame.data() + sizeof head + 2 * place, sizeof value);
  return value;
}

class ViewStream : public testing::Test {
 protected:
  void start_writer(int frames, bool motion = false) {
    writer_ = std::make_unique<shm::Writer>(name_);
    writer_->format.motion = motion;
    ASSERT_TRUE(writer_->open());
    publish(frames);
  }
  void publish(int count) {
    for (int i = 0; i < count; ++i) writer_->publish();
  }
  std::shared_ptr<const std::string> frame_after(const Place& seen) {
    std::shared_ptr<const std::string> frame;
    EXPECT_TRUE(eventually([&] { return (frame = stream_.newest_frame(seen)) != nullptr; }));
    return frame;
  }
  // The trace of a pixel, once it reaches frame `next`.
  nlohmann::ordered_json trace_up_to(std::uint32_t x, std::uint32_t y, std::uint64_t next, const Place& seen) {
    std::optional<nlohmann::ordered_json> trace;
    EXPECT_TRUE(eventually([&] {
      trace = stream_.trace(x, y, seen);
      return trace && (*trace)["next"] == next;
    }));
    return trace.value_or(nlohmann::ordered_json{});
  }

  const std::string name_ =
      shm::unique_name(std::string("view-") + testing::UnitTest::GetInstance()->current_test_info()->name());
  std::unique_ptr<shm::Writer> writer_;
  LiveStream stream_{name_, [] {}};
};

TEST_F(ViewStream, GivesTheNewestFrameOnce) {
  EXPECT_EQ(stream_.newest_frame({}), nullptr) << "no writer yet";
  start_writer(3);
  const auto frame = frame_after({});
  ASSERT_NE(frame, nullptr);
  const FrameHead head = head_of(*frame);
  EXPECT_EQ(std::string(head.magic, 4), "BOLF");
  EXPECT_EQ(head.width, 33U);
  EXPECT_EQ(head.height, 7U);
  EXPECT_EQ(head.number, 2U);
  EXPECT_EQ(head.frame_id, 4U);
  EXPECT_EQ(head.scale, 0.01);
  EXPECT_EQ(head.offset, 5.0);
  ASSERT_EQ(frame->size(), sizeof head + 2 * 2 * 33 * 7);
  for (const std::size_t plane : {0U, 1U}) {
    for (std::size_t i = 0; i < 33 * 7; ++i) ASSERT_EQ(value_at(*frame, plane, i), shm::pattern(2, plane, i));
  }
  EXPECT_EQ(stream_.newest_frame({head.epoch, head.number}), nullptr);
  EXPECT_EQ(stream_.newest_frame({}), frame) << "one copy for all";
  publish(1);
  EXPECT_EQ(head_of(*frame_after({head.epoch, head.number})).number, 3U);
}

TEST_F(ViewStream, SendsTheMotionBehindThePlanes) {
  start_writer(3, true);
  const auto frame = frame_after({});
  const FrameHead head = head_of(*frame);
  ASSERT_EQ(head.number, 2U);
  EXPECT_EQ(head.motion_across, 5U);
  EXPECT_EQ(head.motion_down, 1U);
  const std::size_t planes = sizeof head + 2 * 2 * 33 * 7;
  ASSERT_EQ(frame->size(), planes + 5 * sizeof(bolo_shm_block_motion));
  bolo_shm_block_motion last{};
  std::memcpy(&last, frame->data() + planes + 4 * sizeof last, sizeof last);
  EXPECT_EQ(last.x, shm::motion_pattern(2, 4, 0));
  EXPECT_EQ(last.confidence, shm::motion_pattern(2, 4, 2));
  publish(1);
  const auto without = frame_after({head.epoch, head.number});
  ASSERT_EQ(head_of(*without).number, 3U);
  EXPECT_EQ(head_of(*without).motion_across, 0U) << "not known for this one";
  EXPECT_EQ(without->size(), planes);
}

TEST_F(ViewStream, ATraceHasEveryFrameFromTheRingOn) {
  start_writer(5);
  frame_after({});
  EXPECT_EQ(trace_up_to(4, 2, 5, {})["raw"].size(), 5U);
  publish(40);
  const auto trace = trace_up_to(4, 2, 45, {});
  ASSERT_EQ(trace["raw"].size(), 45U);
  for (std::uint64_t n = 0; n < 45; ++n) {
    EXPECT_EQ(trace["raw"][n], shm::pattern(n, 0, 2 * 33 + 4));
    EXPECT_EQ(trace["deblurred"][n], shm::pattern(n, 1, 2 * 33 + 4));
    EXPECT_NEAR(trace["t_s"][n].get<double>(), 0.005 * static_cast<double>(n), 1e-6);
  }
  EXPECT_EQ(stream_.trace(4, 2, {trace["epoch"], 43})->at("raw").size(), 2U) << "only what was not seen";
}

TEST_F(ViewStream, ATraceIsTenSecondsLongAtMost) {
  start_writer(1);
  frame_after({});
  for (std::uint64_t next = 1; next < 2400;) {
    publish(30);  // fewer than the ring holds
    next += 30;
    trace_up_to(0, 0, next, {1, next});
  }
  EXPECT_EQ(stream_.trace(0, 0, {})->at("raw").size(), 2000U);
}

TEST_F(ViewStream, RefusesPixelsOutsideAndTooMany) {
  EXPECT_FALSE(stream_.trace(0, 0, {})) << "no stream";
  start_writer(1);
  frame_after({});
  EXPECT_FALSE(stream_.trace(33, 0, {}));
  EXPECT_FALSE(stream_.trace(0, 7, {}));
  EXPECT_FALSE(stream_.trace(4294967295U, 4294967295U, {}));
  for (std::uint32_t x = 0; x < LiveStream::kTraces; ++x) EXPECT_TRUE(stream_.trace(x, 0, {})) << x;
  EXPECT_FALSE(stream_.trace(32, 6, {}));
  EXPECT_TRUE(stream_.trace(3, 0, {})) << "one that is followed already";
}

TEST_F(ViewStream, FollowsTheNextWriter) {
  start_writer(4);
  const FrameHead before = head_of(*frame_after({}));
  trace_up_to(1, 1, 4, {});
  EXPECT_EQ(stream_.status()["view"]["stream"], "live");
  writer_.reset();
  EXPECT_TRUE(eventually([this] {
    const auto view = stream_.status()["view"];
    return view["stream"] == "gone" && view["obstacle"] != "";
  }));
  start_writer(4);
  const FrameHead after = head_of(*frame_after({before.epoch, before.number}));
  EXPECT_EQ(after.number, before.number) << "counted anew";
  EXPECT_GT(after.epoch, before.epoch);
  EXPECT_EQ(stream_.status()["view"]["followed"], 1);
  EXPECT_EQ(trace_up_to(1, 1, 4, {before.epoch, 4})["raw"].size(), 4U)
      << "samples of the old writer don't count as seen";
}

}  // namespace bolo::view::view_stream_test
