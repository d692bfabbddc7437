// A recording onto a disk that is slower than the camera: frames are lost by count, the daemon and what was recorded
// are not touched.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>

#include "tests/drivers/shm/shm_rig.hpp"
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

namespace fs = std::filesystem;

constexpr auto kHangGuard = std::chrono::seconds(60);
constexpr int kSlowWrite_ms = 30;  // a frame comes every 2 ms
constexpr std::uint64_t kFramesWhileSlow = 300;
constexpr std::size_t kBufferFrames = 40;

class SlowDisk : public ::testing::Test {
 protected:
  void TearDown() override { g_delay_ms = 0; }

  // Publishes until `enough`, whatever the recorder does.
  template <typename Enough>
  void publish_until(Enough enough) {
    const auto begin = std::chrono::steady_clock::now();
    while (!enough() && std::chrono::steady_clock::now() - begin < kHangGuard) {
      writer_.publish();
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

  // Records while the disk is slow for a while, then as fast as ever, and is stopped.
  RecordResult record_through_a_slow_time() {
    const Geometry geometry = writer_.format.source.format.geometry;
    RecordRequest request;
    request.name = name_;
    request.file = file_;
    request.buffer_bytes = kBufferFrames * geometry.pixels() * sizeof(std::uint16_t);
    Result<RecordResult> result = failed("not run");
    std::atomic<bool> ended{false};
    std::thread recorder([&] {
      result = record(request, stop_, [this](std::uint64_t frames) { written_ = frames; });
      ended = true;
    });
    publish_until([&] { return written_ > 0 || ended; });
    g_delay_ms = kSlowWrite_ms;
    const std::uint64_t slow_until = writer_.next + kFramesWhileSlow;
    publish_until([&] { return writer_.next >= slow_until || ended; });
    g_delay_ms = 0;
    const std::uint64_t written_before = written_;
    publish_until([&] { return written_ > written_before + 2 * kBufferFrames || ended; });
    stop_ = true;
    recorder.join();
    EXPECT_TRUE(result) << result.error().message;
    return result ? std::move(*result) : RecordResult{};
  }

  const Scratch scratch_;
  const fs::path folder_ = scratch_.path();
  std::string name_ = shm::unique_name("slow-disk");
  shm::Writer writer_{name_, {160, 120}};
  std::string file_;
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> written_{0};
};

TEST_F(SlowDisk, CostsFramesByCountAndNothingElse) {
  file_ = (folder_ / "a.h5").string();
  ASSERT_TRUE(writer_.open());
  const RecordResult result = record_through_a_slow_time();
  EXPECT_TRUE(result.status) << result.status.error().message;
  EXPECT_GT(result.lost_no_room, 0U);
  EXPECT_EQ(result.written.unwritten, 0U);

  const auto reader = capture::CaptureReader::open(file_);
  ASSERT_TRUE(reader) << reader.error().message;
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
  const auto is_gap = [](const capture::Event& event) { return event.kind == "gap"; };
  EXPECT_TRUE(std::any_of(reader->events().begin(), reader->events().end(), is_gap));
}

}  // namespace
}  // namespace bolo::tools
