// The slot protocol on plain memory: reader and writer share one mapping, so that the thread sanitizer sees both.
#include "drivers/shm/shared_words.hpp"

#include "tests/test.hpp"

namespace bolo::shm::shared_words_test {

constexpr std::uint64_t kSlots = 4;
constexpr std::size_t kPixels = 20009;  // odd: the plane ends within a word

// Value of every pixel of plane p in frame n, unique within a test. Flat planes are quick to fill, so that the writer
// spends most of its time in the slot.
std::uint16_t pattern(std::uint64_t n, std::uint64_t p) { return static_cast<std::uint16_t>(n * 2 + p); }

struct Slots {
  SlotLayout layout = slot_layout(kPixels * sizeof(std::uint16_t));
  std::vector<std::uint64_t> words = std::vector<std::uint64_t>(kSlots * layout.stride / kWord);

  std::byte* slot(std::uint64_t n) { return reinterpret_cast<std::byte*>(words.data()) + n % kSlots * layout.stride; }
};

void write_frame(Slots& slots, std::uint64_t n) {
  const std::vector<std::uint16_t> raw(kPixels, pattern(n, 0));
  const std::vector<std::uint16_t> deblurred(kPixels, pattern(n, 1));
  bolo_shm_slot head{};
  head.frame_id = n * 3;
  head.flags = static_cast<std::uint32_t>(n);
  write_slot(slots.slot(n), slots.layout, n, head, raw.data(), deblurred.data());
}

// Times from a hostile writer: differences of any two must not overflow.
TEST(SharedWords, TimesAreKeptToWhatDifferencesCanBeTakenOf) {
  Slots slots;
  const std::vector<std::uint16_t> plane(kPixels);
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  for (const std::int64_t ns : {kMost, std::numeric_limits<std::int64_t>::min()}) {
    bolo_shm_slot head{};
    head.camera_ns = head.receive_ns = head.publish_ns = head.host_ns = head.utc_ns = head.utc_uncertainty_ns = ns;
    write_slot(slots.slot(0), slots.layout, 0, head, plane.data(), plane.data());
    bolo_shm_slot read{};
    ASSERT_TRUE(read_slot(slots.slot(0), slots.layout, 0, read, nullptr, nullptr));
    for (const std::int64_t time_ns : {read.camera_ns, read.receive_ns, read.publish_ns, read.host_ns}) {
      EXPECT_LE(std::abs(time_ns), kMost / 4 + 1);
    }
    EXPECT_EQ(read.utc_ns, 0);  // unknown
    EXPECT_GE(read.utc_uncertainty_ns, 0);
    EXPECT_LE(read.utc_uncertainty_ns, kMost / 2);
  }
}

// Reads frame n; fails the test if an accepted frame contains any data of another frame.
bool read_frame(Slots& slots, std::uint64_t n) {
  std::vector<std::uint16_t> raw(kPixels);
  std::vector<std::uint16_t> deblurred(kPixels);
  bolo_shm_slot head{};
  if (!read_slot(slots.slot(n), slots.layout, n, head, raw.data(), deblurred.data())) return false;
  EXPECT_EQ(head.frame_id, n * 3);
  EXPECT_EQ(head.flags, static_cast<std::uint32_t>(n));
  EXPECT_TRUE(std::all_of(raw.begin(), raw.end(), [n](auto v) { return v == pattern(n, 0); })) << "torn frame " << n;
  EXPECT_TRUE(std::all_of(deblurred.begin(), deblurred.end(), [n](auto v) { return v == pattern(n, 1); }))
      << "torn frame " << n;
  return true;
}

TEST(SlotLayout, LeavesWholeWordsForEveryPlaneSize) {
  for (std::size_t bytes = 2; bytes < 300; bytes += 2) {
    const SlotLayout layout = slot_layout(bytes);
    EXPECT_EQ(layout.raw_offset % kWord, 0U);
    EXPECT_EQ(layout.deblurred_offset % kWord, 0U);
    EXPECT_GE(layout.raw_offset, sizeof(bolo_shm_slot));
    EXPECT_GE(layout.deblurred_offset, layout.raw_offset + round_up(bytes, kWord));
    EXPECT_GE(layout.stride, layout.deblurred_offset + round_up(bytes, kWord));
  }
}

TEST(CopyWords, KeepsEveryByteAndTouchesNothingBehindAnOddEnd) {
  for (std::size_t bytes = 0; bytes < 40; ++bytes) {
    std::vector<std::byte> from(bytes);
    for (std::size_t i = 0; i < bytes; ++i) from[i] = static_cast<std::byte>(i + 1);
    std::vector<std::uint64_t> shared(8, 0xeeeeeeeeeeeeeeeeULL);
    copy_in(reinterpret_cast<std::byte*>(shared.data()), from.data(), bytes);
    for (std::size_t w = round_up(bytes, kWord) / kWord; w < shared.size(); ++w) {
      EXPECT_EQ(shared[w], 0xeeeeeeeeeeeeeeeeULL);
    }
    std::vector<std::byte> to(bytes + 1, std::byte{0x55});
    copy_out(to.data(), reinterpret_cast<const std::byte*>(shared.data()), bytes);
    EXPECT_EQ(to.back(), std::byte{0x55});
    to.pop_back();
    EXPECT_EQ(to, from);
  }
}

TEST(Slot, RefusesAFrameThatIsBeingWritten) {
  Slots slots;
  write_frame(slots, 1);
  store_relaxed(*reinterpret_cast<std::uint64_t*>(slots.slot(1)), std::uint64_t{2 * (1 + kSlots) + 1});
  EXPECT_FALSE(read_frame(slots, 1));
  EXPECT_FALSE(read_frame(slots, 1 + kSlots));
}

TEST(Slot, ReaderNeverAcceptsATornFrame) {
  Slots slots;
  constexpr std::uint64_t kFrames = 3000;
  std::atomic<std::uint64_t> published{0};
  std::thread writer([&] {
    for (std::uint64_t n = 0; n < kFrames; ++n) {
      write_frame(slots, n);
      published.store(n + 1, std::memory_order_release);  // partner: the load below
    }
  });
  std::uint64_t newest = 0;
  while (newest < kFrames) {
    newest = published.load(std::memory_order_acquire);  // partner: the store above
    // The oldest frame is overwritten next: the most likely to tear.
    if (newest >= kSlots) read_frame(slots, newest - kSlots);
    if (newest > 0) read_frame(slots, newest - 1);
  }
  writer.join();
  EXPECT_TRUE(read_frame(slots, kFrames - 1)) << "with the writer at rest the newest frame must be readable";
}

}  // namespace bolo::shm::shared_words_test
