// What a daemon tells of its sinks, whose kinds it does not know.
#include <gtest/gtest.h>

#include <prometheus/text_serializer.h>

#include <algorithm>
#include <cerrno>

#include "drivers/v4l2/v4l2_section.hpp"
#include "tests/pipeline/fakes.hpp"
#include "tools/bolod/metrics.hpp"
#include "tools/bolod/state.hpp"

namespace bolo::daemon::sinks_test {
namespace {

// Takes no image.
class BrokenPort final : public v4l2::VideoPort {
 public:
  explicit BrokenPort(std::string path) : path_(std::move(path)) {}
  Status open(const v4l2::VideoFormat& /*format*/) override { return {}; }
  int write(std::span<const std::byte> /*image*/) noexcept override { return ENODEV; }
  void close() noexcept override {}
  const std::string& path() const noexcept override { return path_; }

 private:
  const std::string path_;
};

class Sinks : public testing::Test {
 protected:
  Sinks() {
    for (const char* device : {"/dev/video10", "/dev/video11"}) {
      videos_.push_back(
          std::make_unique<v4l2::V4l2Sink>(v4l2::V4l2Options{.device = device}, std::make_unique<BrokenPort>(device)));
    }
    pipeline::PipelineOptions options;
    options.workers = 1;
    pipeline_ = std::move(
        *pipeline::Pipeline::create(std::make_unique<pipeline::test::ScriptedSource>(pipeline::test::Script{}),
                                    {&plain_, videos_[0].get(), videos_[1].get()}, options));
  }

  pipeline::test::MemorySink plain_;  // that tells nothing
  std::vector<std::unique_ptr<v4l2::V4l2Sink>> videos_;
  std::unique_ptr<pipeline::Pipeline> pipeline_;
  DaemonConfig config_;
};

TEST_F(Sinks, AreInTheState) {
  EXPECT_EQ(state_json(config_, *pipeline_)["video"].dump(),
            R"([{"device":"/dev/video10","open":true,"written":0,"dropped":0,"failures":0},)"
            R"({"device":"/dev/video11","open":true,"written":0,"dropped":0,"failures":0}])");
  const auto without = pipeline::Pipeline::create(
      std::make_unique<pipeline::test::ScriptedSource>(pipeline::test::Script{}), {&plain_}, {});
  EXPECT_EQ(state_json(config_, **without)["video"].dump(), "[]");
}

TEST_F(Sinks, ShareTheFamiliesOfTheMetrics) {
  const std::string name = "camera";
  const rt::Gauge<bool> flows{true};
  const std::string text = prometheus::TextSerializer().Serialize(collect_metrics({name, *pipeline_, flows}));
  for (const char* block : {"# HELP bolo_video_open 1 while the device takes frames\n"
                            "# TYPE bolo_video_open gauge\n"
                            "bolo_video_open{device=\"/dev/video10\"} 1\n"
                            "bolo_video_open{device=\"/dev/video11\"} 1\n",
                            "# HELP bolo_video_frames_written_total Frames that the device took\n"
                            "# TYPE bolo_video_frames_written_total counter\n"
                            "bolo_video_frames_written_total{device=\"/dev/video10\"} 0\n"
                            "bolo_video_frames_written_total{device=\"/dev/video11\"} 0\n",
                            "# HELP bolo_video_frames_dropped_total Frames that it did not take\n",
                            "# HELP bolo_video_failures_total Times that it failed and was let go\n"}) {
    EXPECT_NE(text.find(block), std::string::npos) << block << text;
  }
}

TEST_F(Sinks, TellTheirNoticesThroughThePipeline) {
  int patience = 2000;
  plain_.on_publish = [&](const auto& frame, const auto&) {  // the devices' threads see the first frame by the second
    const auto failed = [](const auto& video) { return video->stats().failures.value() > 0; };
    while (frame.meta.frame_id > 0 && !std::ranges::all_of(videos_, failed) && patience-- > 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  };
  const std::atomic<bool> never{false};
  ASSERT_TRUE(pipeline_->run(never));
  const auto notices = pipeline_->take_notices();
  ASSERT_EQ(notices.size(), 2U);
  for (const auto& notice : notices) EXPECT_EQ(notice.event, pipeline::event::kVideoLost);
  EXPECT_TRUE(notices[0].text.starts_with("/dev/video10 takes no more frames")) << notices[0].text;
}

}  // namespace
}  // namespace bolo::daemon::sinks_test
