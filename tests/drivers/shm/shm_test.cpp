// Frames through shared memory: one writer, one reader, everything in order.
#include <fcntl.h>
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <climits>

#include "drivers/shm/shm_object.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/refusal.hpp"

namespace bolo::shm::shm_test {

using Outcome = ShmReader::Outcome;

// Fields that libbolo-client reads are tested with it.
TEST(ShmRoundTrip, HeaderSaysWhatTheWriterWasGiven) {
  Stream stream("header", {33, 7}, [](Writer& writer) {
    writer.format.deblur.window = 17;
    writer.format.deblur.lookahead = 1;
    writer.format.deblur.tau_s = 0.012;
    writer.format.source.format.row_step = 4;
    writer.format.solver_text = std::string(100, 'x');
    writer.format.row_delay_s = 2.8e-5;
  });
  const bolo_shm_header header = stream.reader->header();
  EXPECT_DOUBLE_EQ(header.tau_s, 0.012);
  EXPECT_EQ(header.window, 17U);
  EXPECT_EQ(header.lookahead, 1U);
  EXPECT_EQ(header.row_step, 4U);
  EXPECT_DOUBLE_EQ(header.row_delay_s, 2.8e-5);
  EXPECT_EQ(header.clock_error_ns, kUnboundedClockErrorNs) << "nothing is known of the clock yet";
  EXPECT_EQ(std::string(header.solver), std::string(63, 'x')) << "a long text is cut and ended";
  EXPECT_EQ(header.state, std::uint32_t{BOLO_SHM_RUNNING});
  EXPECT_GE(header.slot_count, 64U);
  EXPECT_LE(header.start_ns, monotonic_ns());
}

TEST(ShmRoundTrip, FramesArePixelExactForEveryOddSize) {
  for (const Geometry geometry : {Geometry{1, 1}, Geometry{3, 1}, Geometry{5, 3}, Geometry{64, 2}, Geometry{641, 3}}) {
    Stream stream("exact", geometry);
    ReadFrame frame;
    for (std::uint64_t n = 0; n < 200; ++n) {  // three times around the ring
      stream.writer.publish();
      ASSERT_EQ(stream.reader->read(n, frame, 0), Outcome::kFrame);
      ASSERT_EQ(frame.raw.size(), geometry.pixels());
      ASSERT_TRUE(intact(frame, n));
      const auto i = static_cast<std::int64_t>(n);
      EXPECT_EQ(frame.meta.camera_ns, i * 5'000'000);
      EXPECT_EQ(frame.meta.receive_ns, 1000 + i);
      EXPECT_EQ(frame.publish_ns, 2000 + i);
      EXPECT_EQ(frame.meta.utc_ns, utc_of(n));
      EXPECT_EQ(frame.meta.utc_uncertainty_ns, 1'500'001);
      EXPECT_EQ(frame.meta.flags, n % 5 == 0 ? std::uint32_t{kFlagGap} : 0U);
    }
  }
}

TEST(ShmRoundTrip, CountersReachTheReader) {
  Stream stream("counters");
  stream.writer.inlet.count_loss(LossCause::kMissing, 3);
  stream.writer.inlet.count_loss(LossCause::kOutOfOrder, 2);
  stream.writer.stats.restarts.add(4);
  stream.writer.stats.warm_up.add(5);
  stream.writer.stats.gap_frames.add(6);
  stream.writer.stats.deblur_ns.add(7);
  stream.writer.stats.clock_steps.add(8);
  stream.writer.stats.clock_synchronised.set(1);
  stream.writer.stats.clock_error_ns.set(900);
  stream.writer.stats.latency.add(3'000'000);
  stream.writer.publish();
  const bolo_shm_header header = stream.reader->header();
  EXPECT_EQ(header.published, 1U);
  EXPECT_EQ(header.lost[static_cast<std::size_t>(LossCause::kMissing)], 3U);
  EXPECT_EQ(header.lost[static_cast<std::size_t>(LossCause::kOutOfOrder)], 2U);
  EXPECT_EQ(header.restarts, 4U);
  EXPECT_EQ(header.warm_up, 5U);
  EXPECT_EQ(header.gap_frames, 6U);
  EXPECT_EQ(header.deblur_ns, 7U);
  EXPECT_EQ(header.clock_steps, 8U);
  EXPECT_EQ(header.clock_synchronised, 1U);
  EXPECT_EQ(header.clock_error_ns, 900);
  EXPECT_EQ(header.latency[rt::LatencyHistogram::bucket(3'000'000)], 1U);
  stream.writer.inlet.count_loss(LossCause::kMissing, 1);
  stream.writer.sink.idle(stream.writer.stats);
  EXPECT_EQ(stream.reader->header().lost[static_cast<std::size_t>(LossCause::kMissing)], 4U)
      << "idle() brings them too";
  EXPECT_GE(stream.reader->header().heartbeat_ns, header.heartbeat_ns);
}

TEST(ShmRoundTrip, ThePeriodIsTheOneThatFramesAreSolvedWith) {
  Stream stream("period");
  stream.writer.stats.period_s.set(0.02);
  stream.writer.publish();
  EXPECT_EQ(must(ShmReader::open(stream.name))->header().frame_period_s, 0.02);
}

TEST(ShmRoundTrip, NoCounterIsBehindTheFramesThatAReaderSees) {
  constexpr std::uint64_t kFrames = 20'000;
  Stream stream("order", {8, 2});
  std::jthread writer([&] {
    for (std::uint64_t n = 0; n < kFrames; ++n) {
      stream.writer.stats.warm_up.add();
      stream.writer.publish();
    }
  });
  for (bolo_shm_header header{}; header.published < kFrames;) {
    header = stream.reader->header();
    ASSERT_GE(header.warm_up, header.published);
  }
}

TEST(ShmRoundTrip, MotionStandsBesideTheFrameThatItIsOf) {
  for (const Geometry geometry : {Geometry{33, 7}, Geometry{640, 120}, Geometry{8, 8}, Geometry{1, 1}}) {
    Stream stream("motion", geometry, [](Writer& writer) { writer.format.motion = true; });
    const bolo_shm_header header = stream.reader->header();
    EXPECT_EQ(header.motion_across, static_cast<std::uint32_t>((geometry.width + 7) / 8));
    EXPECT_EQ(header.motion_down, static_cast<std::uint32_t>((geometry.height + 7) / 8));
    ReadFrame frame;
    for (std::uint64_t n = 0; n < 150; ++n) {  // twice around the ring: motion must not stay in a reused slot
      stream.writer.publish();
      ASSERT_EQ(stream.reader->read(n, frame, 0), Outcome::kFrame);
      ASSERT_EQ(frame.motion.size(), moves(n) ? std::size_t{header.motion_across} * header.motion_down : 0U) << n;
      ASSERT_TRUE(intact(frame, n));
      const auto lent = stream.reader->borrow(n);
      ASSERT_TRUE(lent);
      ASSERT_EQ(lent->motion() != nullptr, moves(n)) << n;
      if (!moves(n)) continue;
      EXPECT_EQ(lent->motion_blocks()[0].y, motion_pattern(n, 0, 1));
    }
  }
}

TEST(ShmRoundTrip, StreamsWithoutMotionHaveNoRoomForIt) {
  Stream stream("no-motion");
  stream.writer.publish();
  const bolo_shm_header header = stream.reader->header();
  EXPECT_EQ(header.motion_offset, 0U);
  EXPECT_EQ(header.motion_across * header.motion_down, 0U);
  EXPECT_EQ(header.slot_stride, 128U + 2 * 512U) << "33 x 7 pixels of 2 bytes, twice";
  ReadFrame frame;
  ASSERT_EQ(stream.reader->read(0, frame, 0), Outcome::kFrame);
  EXPECT_TRUE(frame.motion.empty());
  deblur::Settings settings;
  const std::uint64_t without = bytes_needed({stream.name, 64, 0644, ""}, settings, {640, 120});
  settings.method = deblur::Method::kMotion;
  EXPECT_EQ(bytes_needed({stream.name, 64, 0644, ""}, settings, {640, 120}) - without, 64U * (64 + 1200 * 12));
}

TEST(ShmReader, SaysThatAFrameIsGone) {
  Stream stream("gone");
  const std::uint64_t slots = stream.reader->header().slot_count;
  for (std::uint64_t n = 0; n <= slots; ++n) stream.writer.publish();
  ReadFrame frame;
  EXPECT_EQ(stream.reader->read(0, frame, 0), Outcome::kOverwritten);
  ASSERT_EQ(stream.reader->read(1, frame, 0), Outcome::kFrame) << "the whole ring is readable";
  EXPECT_TRUE(intact(frame, 1));
}

// A read-only mapping lets another process requeue all futex waiters to a word that the writer does not wake.
TEST(ShmReader, AnotherReaderDelaysItByLittleMoreThanAPeriod) {
  Stream stream("requeue");
  const int fd = shm_open(("/bolo." + stream.name).c_str(), O_RDONLY, 0);
  void* const memory = mmap(nullptr, sizeof(bolo_shm_header), PROT_READ, MAP_SHARED, fd, 0);
  close(fd);
  ASSERT_NE(memory, MAP_FAILED);
  const std::uint32_t& wake = static_cast<const bolo_shm_header*>(memory)->wake;
  std::uint32_t elsewhere = 0;
  constexpr std::size_t kRounds = 21;
  std::vector<double> late_ms;
  for (std::uint64_t round = 0; round < kRounds; ++round) {
    std::int64_t seen_ns = 0;
    std::thread waiting([&] {
      EXPECT_EQ(stream.reader->wait(round, 60'000), Outcome::kFrame);
      seen_ns = monotonic_ns();
    });
    while (syscall(SYS_futex, &wake, FUTEX_REQUEUE, 0, INT_MAX, &elsewhere, 0) < 1) std::this_thread::yield();
    const std::int64_t published_ns = monotonic_ns();
    stream.writer.publish();
    waiting.join();
    late_ms.push_back(static_cast<double>(seen_ns - published_ns) * 1e-6);
  }
  munmap(memory, sizeof(bolo_shm_header));
  std::nth_element(late_ms.begin(), late_ms.begin() + kRounds / 2, late_ms.end());
  EXPECT_LT(late_ms[kRounds / 2], 50.0) << "of a period of 5 ms; without a bound of its own it sleeps for 100";
}

TEST(ShmReader, TimesOutWithoutAFrameAndWakesWithOne) {
  Stream stream("wait");
  ReadFrame frame;
  EXPECT_EQ(stream.reader->read(0, frame, 0), Outcome::kTimeout);
  EXPECT_EQ(stream.reader->read(0, frame, 5), Outcome::kTimeout);
  std::jthread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    stream.writer.publish();
  });
  EXPECT_EQ(stream.reader->read(0, frame, 60'000), Outcome::kFrame);
  EXPECT_TRUE(intact(frame, 0));
}

TEST(ShmReader, NamesWhatExistsWhenTheNameIsUnknown) {
  const std::string name = unique_name("names");
  Writer writer(name);
  ASSERT_TRUE(writer.open());
  expect_refused(ShmReader::open("no-such-camera"), {"no shared memory named 'no-such-camera'", name});
  writer.sink.close();
  const auto left = object_names();
  EXPECT_EQ(std::count(left.begin(), left.end(), name), 0) << "an orderly end leaves nothing behind";
}

TEST(ShmReader, RefusesNamesThatAreNoNames) {
  for (const std::string name : {"", "a/b", "../passwd", "a b", "caf\xc3\xa9"}) {
    expect_refused(ShmReader::open(name), {"is no name for shared memory"});
  }
  EXPECT_FALSE(ShmReader::open(std::string(201, 'a')));
}

}  // namespace bolo::shm::shm_test
