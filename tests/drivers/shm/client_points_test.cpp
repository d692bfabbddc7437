// Points on demand through libbolo-client against the planes of a running pipeline.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "drivers/shm/shm_sink.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tests/drivers/shm/client_rig.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::shm::client_points_test {
namespace {

constexpr std::uint64_t kFrames = 60;  // all of them stay in the ring

TEST(ClientPoints, AreThePublishedPlanesValues) {
  const std::string name = unique_name("client-points");
  std::atomic<bool> opened{false};
  std::atomic<bool> stop{false};
  pipeline::test::Script script;
  script.frames = pipeline::test::run_of(0, kFrames);
  script.ends = false;
  script.fill = [&](rt::FrameSlot& slot, const StreamFormat& format) {
    while (!opened && !stop) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    pipeline::test::fill_moving_bar(slot, format);
  };
  pipeline::PipelineOptions options;
  options.workers = 1;
  options.deblur.lookahead = 1;
  ShmSink sink({name, 0, 0644, ""});
  auto pipeline =
      pipeline::Pipeline::create(std::make_unique<pipeline::test::ScriptedSource>(std::move(script)), {&sink}, options);
  ASSERT_TRUE(pipeline);
  std::thread daemon([&] { EXPECT_TRUE((*pipeline)->run(stop)); });
  const Client client = open_client(name, 60'000);
  opened = true;

  std::vector<bolo_client_point> points{{0, 0}, {23, 6}, {7, 3}};
  int solved = 0;
  int warm_up = 0;
  bolo_client_frame frame{};
  // With look-ahead the pipeline keeps the last frame.
  while (client && frame.number + 2 < kFrames && bolo_client_next(client.get(), 60'000, &frame) == BOLO_CLIENT_OK) {
    if (frame.number % 7 == 0) points.push_back({static_cast<std::uint32_t>(frame.number % 24), 2});
    std::vector<float> values(points.size(), -1.0F);
    const std::uint64_t number = frame.number;
    // What a frame's window looks ahead to is in the ring with the next frame's slot.
    int result = BOLO_CLIENT_NOT_YET;
    while (result == BOLO_CLIENT_NOT_YET && number + 2 < kFrames) {
      result = bolo_client_points(client.get(), number, points.data(), points.size(), values.data());
    }
    if (result == BOLO_CLIENT_WARM_UP) {
      ++warm_up;
      EXPECT_NE(frame.flags & BOLO_FLAG_WARM_UP, 0U);
      EXPECT_EQ(values[0], -1.0F);
      continue;
    }
    if (number + 2 >= kFrames) break;
    if (result != BOLO_CLIENT_OK) {
      ADD_FAILURE() << bolo_client_error(client.get());
      break;
    }
    ++solved;
    std::vector<float> plane(std::size_t{frame.width} * frame.height);
    EXPECT_EQ(bolo_client_kelvin(client.get(), frame.deblurred, plane.size(), plane.data()), BOLO_CLIENT_OK);
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(values[i], plane[points[i].y * frame.width + points[i].x]) << "frame " << frame.number;
    }
  }
  stop = true;
  daemon.join();
  ASSERT_TRUE(client);
  EXPECT_GT(warm_up, 0);
  EXPECT_GT(solved, 20);
}

}  // namespace
}  // namespace bolo::shm::client_points_test
