// A recording to a disk slower than the camera: lost frames are counted; the daemon and recorded frames are unaffected.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>

#include "src/capture/crash_safe_file.hpp"
#include "tests/capture/frame_values.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/no_threads.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tools/record/recording.hpp"

namespace {

std::atomic<int> g_delay_ms{0};
std::atomic<int> g_stat_error{0};
std::atomic<int> g_calls_until_error{-1};   // of pread and pwrite; < 0: none comes
std::atomic<int> g_news_until_refusal{-1};  // of threads beside the main one; likewise

bool disk_errs() {
  if (g_calls_until_error < 0 || g_calls_until_error-- > 0) return false;
  errno = EIO;
  return true;
}

}  // namespace

// Replaces the C library's function, through which all writes of a recording go.
extern "C" ssize_t pwrite(int descriptor, const void* data, size_t bytes, off_t offset) {
  std::this_thread::sleep_for(std::chrono::milliseconds(g_delay_ms.load()));
  if (disk_errs()) return -1;
  using Function = ssize_t(int, const void*, size_t, off_t);
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, "pwrite"))(descriptor, data, bytes, offset);
}

extern "C" ssize_t pread(int descriptor, void* data, size_t bytes, off_t offset) {
  if (disk_errs()) return -1;
  using Function = ssize_t(int, void*, size_t, off_t);
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, "pread"))(descriptor, data, bytes, offset);
}
extern "C" int stat(const char* path, struct stat* about) {
  errno = g_stat_error.load();
  return errno != 0 ? -1 : fstatat(AT_FDCWD, path, about, 0);
}

void* operator new(std::size_t bytes) {
  if (gettid() != getpid() && g_news_until_refusal >= 0 && g_news_until_refusal-- == 0) throw std::bad_alloc();
  void* const memory = std::malloc(std::max<std::size_t>(bytes, 1));
  return memory != nullptr ? memory : throw std::bad_alloc();
}
void* operator new[](std::size_t bytes) { return operator new(bytes); }
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept { return std::malloc(bytes); }
void* operator new[](std::size_t bytes, const std::nothrow_t&) noexcept { return std::malloc(bytes); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }

namespace bolo::tools::slow_disk_test {

constexpr int kSlowWrite_ms = 30;  // a frame comes every 2 ms
constexpr std::uint64_t kFramesWhileSlow = 300;
constexpr std::size_t kBufferFrames = 40;

class SlowDisk : public ScratchTest {
 protected:
  void TearDown() override { g_delay_ms = 0; }

  // Records into file_ until `publish` has done, and is stopped.
  template <typename Publish>
  RecordResult record_while(Publish publish, double split_s = 0.0) {
    const std::size_t plane_bytes = writer_.format.source.format.geometry.pixels() * sizeof(std::uint16_t);
    const RecordRequest request{
        .name = name_, .writer = {.file = file_, .split_s = split_s, .buffer_bytes = kBufferFrames * plane_bytes}};
    Result<RecordResult> result = failed("not run");
    must(writer_.open());
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

  const std::string file_ = scratch_ / "a.h5";
  const std::string name_ = shm::unique_name("slow-disk");
  shm::Writer writer_{name_, {160, 120}};
  std::atomic<bool> stop_{false};
  std::atomic<bool> ended_{false};
  std::atomic<std::uint64_t> written_{0};
};

TEST_F(SlowDisk, CostsFramesByCountAndNothingElse) {
  const RecordResult result = record_through_a_slow_time();
  EXPECT_TRUE(result.status) << result.status.error().message;
  EXPECT_GT(result.lost_no_room, 0U);
  EXPECT_EQ(result.written.unwritten, 0U);

  const auto reader = must(capture::CaptureReader::open(file_));
  ASSERT_EQ(reader->info().frames, result.written.frames);
  std::uint64_t missing = 0;
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    const std::uint64_t number = reader->frame_id()[i] / 2;
    if (i > 0) missing += number - reader->frame_id()[i - 1] / 2 - 1;
    const auto plane = capture::testing::frame_values(*reader, i);
    for (std::size_t p = 0; p < plane.size(); ++p) ASSERT_EQ(plane[p], shm::pattern(number, 0, p)) << "frame " << i;
  }
  EXPECT_EQ(missing, result.lost_no_room + result.lost_overwritten);
  EXPECT_NE(std::ranges::find(reader->events(), "gap", &capture::Event::kind), reader->events().end());
}

// Refuses each allocation of the writer's and the disk's threads in turn.
TEST(Memory, ThatIsRefusedEndsARecordingAsAGoodCapture) {
  constexpr std::uint64_t kFrames = 40;
  bool refused = true;
  for (int news = 0; refused; news += 1 + news / 8) {
    const Scratch scratch;
    FileWriterOptions options{.file = scratch / "a.h5", .buffer_bytes = 1 << 20, .log = [](const std::string&) {}};
    options.info.format = {.geometry = {16, 8}, .type = PixelType::kUint16, .frame_period_s = 0.005};
    const std::unique_ptr<FileWriter> writer = std::move(*must(FileWriter::start(std::move(options))));
    g_news_until_refusal = news;
    for (std::uint64_t i = 0; i < kFrames; ++i) {
      rt::FrameSlot* const slot = writer->take();
      ASSERT_NE(slot, nullptr);
      std::fill_n(slot->u16(), 16 * 8, static_cast<std::uint16_t>(i));
      slot->meta = {.frame_id = i, .camera_ns = static_cast<std::int64_t>(i) * 5'000'000};
      writer->put(*slot, 0, 0.005);
    }
    const FileWriterResult done = writer->finish();
    refused = g_news_until_refusal.exchange(-1) < 0;
    EXPECT_TRUE(done.status || refused) << news;
    const std::string why = done.status ? "" : done.status.error().message;
    EXPECT_TRUE(done.status || why.ends_with("not enough memory") || why.ends_with(std::strerror(ENOMEM))) << why;
    for (const auto& files : {done.files, done.parts}) {
      for (const auto& file : files) {
        auto reader = capture::CaptureReader::open(file);
        if (!reader) {  // refused at its only commit
          EXPECT_FALSE(done.status);
          expect_parts(reader.error().message, {"/frames is empty"});
          continue;
        }
        for (std::size_t i = 0; i < reader->info().frames; ++i) {
          EXPECT_EQ(reader->frame_id()[i], i) << news;
          EXPECT_EQ(capture::testing::frame_values(*reader, i), std::vector(16 * 8, static_cast<std::uint16_t>(i)))
              << news;
        }
      }
    }
  }
}

// The same for a capture that is given up while frames await their commit.
TEST(Memory, ThatIsRefusedToACaptureThatIsGivenUpEndsNothing) {
  bool refused = true;
  for (int news = 0; refused; ++news) {
    const Scratch scratch;
    std::thread([&] {
      capture::CaptureInfo info;
      info.format = {.geometry = {16, 8}, .type = PixelType::kUint16, .frame_period_s = 0.005};
      auto capture = must(capture::CaptureWriter::create(scratch / "a.h5", info));
      const std::vector<std::uint16_t> plane(16 * 8);
      must(capture->append(0.0, 0, plane.data()));
      must(capture->add_event({0.0, "gap"}));
      g_news_until_refusal = news;
      const capture::CaptureWriter given_up = std::move(*capture);
    }).join();
    refused = g_news_until_refusal.exchange(-1) < 0;
  }
}

// Then the recorder closes its files itself.
TEST_F(SlowDisk, NoThreadCanBeStarted) {
  constexpr double kSplit_s = 0.2;
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

// Its frames are not among those of the files.
TEST_F(SlowDisk, APartThatCannotGetItsNameIsTold) {
  constexpr double kSplit_s = 0.2;
  const RecordResult result = record_while(
      [this] {
        std::ofstream(scratch_ / "a_001.h5") << "another program's";
        writer_.publish_until([&] { return written_ > 200 || ended_; });
      },
      kSplit_s);
  EXPECT_FALSE(result.status);
  EXPECT_EQ(result.written.parts, std::vector<std::filesystem::path>{scratch_ / "a_001.h5.part"});
  EXPECT_FALSE(result.written.files.empty());
}

// As NFS fails for a while (ESTALE).
TEST_F(SlowDisk, WhatCannotBeBegunIsNoUnfinishedRecording) {
  g_stat_error = ESTALE;
  const auto begun = capture::CrashSafeFile::create(file_, capture::SurvivesCut::kPower, Replace::kNothing);
  g_stat_error = 0;
  expect_refused(begun, {"cannot be created: Stale file handle"});
  EXPECT_FALSE(std::filesystem::exists(file_));
}

// Whichever read or write fails (bad sector, network): renamed files can be read, others recovered.
TEST_F(SlowDisk, OneErrorCostsNoFrameThatWasCommitted) {
  const capture::CaptureInfo info{.format = {.geometry = {16, 8}, .frame_period_s = 0.01}};
  const capture::WriterOptions how{.survives_power_cut = true, .times = true};
  const std::vector<std::uint16_t> plane(info.format.geometry.pixels(), 7);
  const capture::FrameTimes times{};
  bool erred = true;
  for (int calls = 0; erred; ++calls) {
    const std::filesystem::path file = scratch_ / ("one-error-" + std::to_string(calls) + ".h5");
    auto writer = must(capture::CaptureWriter::create(file, info, how));
    g_calls_until_error = calls;
    std::size_t committed = 0;
    for (std::size_t i = 0; i < 12; ++i) {
      if (!writer->append(0.01 * static_cast<double>(i), i, plane.data(), nullptr, nullptr, &times)) break;
      if (i % 4 == 3) {
        if (!writer->commit()) break;
        committed = i + 1;
      }
    }
    const Status closed = writer->close();
    erred = g_calls_until_error.exchange(-1) < 0;
    if (!closed) {
      { const auto gone = std::move(*writer); }
      const auto saved = capture::recover_copy(file.string() + ".part", {file}, {});
      EXPECT_TRUE(saved || committed == 0) << calls << ": " << saved.error().message << "; " << closed.error().message;
    }
    const auto reader = capture::CaptureReader::open(file);
    EXPECT_TRUE(reader || (!closed && committed == 0)) << calls << ": " << reader.error().message;
    EXPECT_GE(reader ? reader->info().frames : 0, committed) << calls;
  }
}

// The least limit of a group and its parents; "max" is no limit.
TEST(MemoryLimit, IsOfAllGroups) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / shm::unique_name("groups");
  const std::filesystem::path inner = folder / "system.slice" / "recorder.service";
  std::filesystem::create_directories(inner);
  const auto limit_within = [&](const char* own) {
    std::ofstream(folder / "own") << own;
    return memory_limit(folder, folder / "own");
  };
  constexpr std::uint64_t kAny = ~std::uint64_t{0};
  std::ofstream(inner / "memory.max") << "max\n";
  EXPECT_EQ(limit_within("0::/system.slice/recorder.service\n"), kAny);
  std::ofstream(folder / "system.slice" / "memory.max") << "3000\n";
  EXPECT_EQ(limit_within("1:cpu:/\n0::/system.slice/recorder.service\n"), 3000U);
  std::ofstream(inner / "memory.max") << "2000\n";
  EXPECT_EQ(limit_within("0::/system.slice/recorder.service\n"), 2000U);
  EXPECT_EQ(limit_within("0::/system.slice\n"), 3000U);
  EXPECT_EQ(limit_within("0::/\n"), kAny);
  std::ofstream(folder / "memory.max") << "1000\n";  // a container's own
  EXPECT_EQ(limit_within("0::/\n"), 1000U);
  EXPECT_EQ(limit_within("4:memory:/other\n"), kAny);
  EXPECT_EQ(memory_limit(folder, folder / "missing"), kAny);
  std::filesystem::remove_all(folder);
}

}  // namespace bolo::tools::slow_disk_test
