// Counts allocations in the daemon's parts while frames flow from a camera's packets to shared memory and a video
// device. Separate program, as it replaces the allocator; the camera runs in another one and is not counted.
#include "drivers/genicam/genicam_source.hpp"
#include "drivers/shm/shm_reader.hpp"
#include "drivers/shm/shm_sink.hpp"
#include "drivers/v4l2/v4l2_sink.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tests/drivers/v4l2/fake_port.hpp"
#include "tests/pipeline/count_allocations.hpp"
#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"

namespace bolo::daemon::allocation_test {

constexpr Geometry kGeometry{64, 24};
constexpr std::uint64_t kFirstArmed = 100;
constexpr std::uint64_t kLastArmed = 500;
constexpr std::uint64_t kLast = 520;

std::unique_ptr<int> g_kept;  // global: the compiler cannot optimise the allocation away

// Arms the counter once all threads run, and ends the run.
class ArmingSink final : public pipeline::FrameSink {
 public:
  explicit ArmingSink(bool allocates) : allocates_(allocates) {}
  Status open(const pipeline::SinkFormat& /*format*/) override { return {}; }
  void publish(const pipeline::PublishedFrame& /*frame*/, const pipeline::PipelineStats& /*stats*/) noexcept override {
    ++frames_;
    if (frames_ == kFirstArmed) test::arm_allocation_count();
    if (frames_ == kFirstArmed + 1 && allocates_) g_kept = std::make_unique<int>(1);
    if (frames_ == kLastArmed) test::disarm_allocation_count();
    if (frames_ == kLast) stop_.store(true);
  }
  void close() noexcept override { test::disarm_allocation_count(); }
  const std::atomic<bool>& stop() const { return stop_; }
  std::uint64_t frames() const { return frames_; }

 private:
  const bool allocates_;
  std::uint64_t frames_ = 0;
  std::atomic<bool> stop_{false};
};

std::uint64_t allocations_of_a_run(bool one_is_made) {
  const Scratch scratch;
  const std::string capture = scratch / "in.h5";
  tools::test::SmallCapture frames(capture, tools::test::small_info(kGeometry));
  for (std::uint64_t id = 0; id < 40; ++id) {
    frames.append(static_cast<double>(id) * 0.005, id, [id](std::size_t i) { return 30'000 + 7 * id + i; });
  }
  frames.close();
  const std::string address = tools::test::own_address();
  tools::test::Program camera({BOLO_PROGRAM, "fakecam", capture, "--loop", "--interface", address}, scratch / "camera");
  EXPECT_TRUE(eventually([&] { return camera.out().find("serving") != std::string::npos; }));
  const genicam::CameraOptions options{
      .address = address, .width = kGeometry.width, .height = kGeometry.height, .rate_hz = 200.0};
  shm::ShmSink shared({.name = "test-allocation-" + std::to_string(getpid()), .mode = 0600});
  v4l2::V4l2Sink video({}, std::make_unique<v4l2::test::FakePort>(std::make_shared<v4l2::test::FakeDevice>()));
  ArmingSink arming(one_is_made);
  const pipeline::PipelineOptions how{.workers = 2, .degrade = true};
  const std::vector<pipeline::FrameSink*> sinks{&arming, &shared, &video};
  auto pipeline = must(pipeline::Pipeline::create(std::make_unique<genicam::GenicamSource>(options), sinks, how));
  test::reset_allocation_count();
  must((*pipeline)->run(arming.stop()));
  EXPECT_GE(arming.frames(), kLast);
  EXPECT_GT(video.stats().written.value(), 0U);
  testing::Test::RecordProperty("allocations_of_Aravis", std::to_string(test::library_allocation_count()));
  return test::allocation_count();
}

TEST(Allocation, NoneFromACamerasPacketsToSharedMemoryAndVideo) { EXPECT_EQ(allocations_of_a_run(false), 0U); }

TEST(Allocation, OneIsSeen) { EXPECT_EQ(allocations_of_a_run(true), 1U); }

}  // namespace bolo::daemon::allocation_test
