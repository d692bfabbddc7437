// A recording onto a disk that is slower than the camera: frames are lost by count, the daemon and what was recorded
// are not touched.
#include <dlfcn.h>

#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/no_threads.hpp"
#include "tests/scratch.hpp"
#include "tools/record/recording.hpp"

namespace {

std::atomic<int> g_delay_ms{0};

}  // namespace

// Takes the place of the C library's: all that a recording writes goes through it.
extern "C" ssize_t pwrite(int descriptor, const void* data, size_t bytes, off_t offset) {
  std::this_thread::sleep_for(std::chrono::milliseconds(g_delay_ms.load()));
  using Function = ssize_t(int, const void*, size_t, off_t);
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, "pwrite"))(descriptor, data, bytes, offset);
}

namespace bolo::tools {
namespace {

constexpr int kSlowWrite_ms = 30;  // a frame comes every 2 ms
constexpr std::uint64_t kFramesWhileSlow = 300;
constexpr std::size_t kBufferFrames = 40;

class SlowDisk : public ::testing::Test {
 protected:
  void TearDown() override { g_delay_ms = 0; }

  // Records into file_ until `publish` has done, and is stopped.
  template <typename Publish>
  RecordResult record_while(Publish publish, double split_s = 0.0) {
    RecordRequest request;
    request.name = name_;
    request.file = file_;
    request.split_s = split_s;
    request.buffer_bytes = kBufferFrames * writer_.format.source.format.geometry.pixels() * sizeof(std::uint16_t);
    Result<RecordResult> result = failed("not run");
    std::thread recorder([&] {
      result = record(request, stop_, [this](std::uint64_t frames) { written_ = frames; });
      ended_ = true;
    });
    writer_.publish_until([&] { return written_ > 0 || ended_; });
    publish();
    stop_ = true;
    recorder.join();
    EXPECT_TRUE(result) << result.error().message;
    return result ? std::move(*result) : RecordResult{};
  }

  // Records while the disk is slow for a while, then as fast as ever.
  RecordResult record_through_a_slow_time() {
    return record_while([this] {
      g_delay_ms = kSlowWrite_ms;
      const std::uint64_t slow_until = writer_.next + kFramesWhileSlow;
      writer_.publish_until([&] { return writer_.next >= slow_until || ended_; });
      g_delay_ms = 0;
      const std::uint64_t written_before = written_;
      writer_.publish_until([&] { return written_ > written_before + 2 * kBufferFrames || ended_; });
    });
  }

  const Scratch scratch_;
  const std::string file_ = scratch_ / "a.h5";
  const std::string name_ = shm::unique_name("slow-disk");
  shm::Writer writer_{name_, {160, 120}};
  std::atomic<bool> stop_{false};
  std::atomic<bool> ended_{false};
  std::atomic<std::uint64_t> written_{0};
};

TEST_F(SlowDisk, CostsFramesByCountAndNothingElse) {
  ASSERT_TRUE(writer_.open());
  const RecordResult result = record_through_a_slow_time();
  EXPECT_TRUE(result.status) << result.status.error().message;
  EXPECT_GT(result.lost_no_room, 0U);
  EXPECT_EQ(result.written.unwritten, 0U);

  const auto reader = must(capture::CaptureReader::open(file_));
  ASSERT_EQ(reader->info().frames, result.written.frames);
  std::vector<std::uint16_t> plane(reader->info().format.geometry.pixels());
  std::uint64_t missing = 0;
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    const std::uint64_t number = reader->frame_id()[i] / 2;
    if (i > 0) missing += number - reader->frame_id()[i - 1] / 2 - 1;
    ASSERT_TRUE(reader->read_frame(i, plane.data()));
    for (std::size_t p = 0; p < plane.size(); ++p) ASSERT_EQ(plane[p], shm::pattern(number, 0, p)) << "frame " << i;
  }
  EXPECT_EQ(missing, result.lost_no_room + result.lost_overwritten);
  EXPECT_NE(std::ranges::find(reader->events(), "gap", &capture::Event::kind), reader->events().end());
}

// The recorder closes its files itself then.
TEST_F(SlowDisk, NoThreadCanBeStarted) {
  constexpr double kSplit_s = 0.2;
  ASSERT_TRUE(writer_.open());
  const RecordResult result = record_while(
      [this] {
        const NoThreads none;
        writer_.publish_until([&] { return written_ > 100 || ended_; });
        stop_ = true;
        writer_.publish_until([&] { return ended_.load(); });
      },
      kSplit_s);
  EXPECT_TRUE(result.status) << result.status.error().message;
  ASSERT_GT(result.written.files.size(), 1U);
  std::size_t frames = 0;
  for (const auto& file : result.written.files) frames += must(capture::CaptureReader::open(file))->info().frames;
  EXPECT_EQ(frames, result.written.frames);
}

}  // namespace
}  // namespace bolo::tools
