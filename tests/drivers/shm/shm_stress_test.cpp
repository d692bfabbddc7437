// Full speed between processes: a reader may miss frames, but never accepts a torn one.
#include <linux/futex.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>

#include "drivers/shm/shared_words.hpp"
#include "drivers/shm/shm_sink.hpp"
#include "tests/drivers/shm/shm_rig.hpp"

namespace bolo::shm::shm_stress_test {

using Outcome = ShmReader::Outcome;

constexpr std::uint64_t kFrames = 4000;
constexpr int kExitGood = 0;
constexpr int kExitTorn = 3;
constexpr int kExitUnreadable = 4;

// Reader process: signals through `ready` that it has opened the stream, then follows it to the end, restarting at the
// oldest frame of the ring whenever it falls behind.
int follow(const std::string& name, int ready) {
  auto reader = ShmReader::open(name);
  if (!reader || write(ready, "r", 1) != 1) return kExitUnreadable;
  const std::uint64_t slots = reader->header().slot_count;
  ReadFrame frame;
  std::uint64_t next = 0;
  std::uint64_t good = 0;
  std::uint64_t moved = 0;
  while (true) {
    // The oldest frame is overwritten next: the most likely to tear.
    const std::uint64_t newest = reader->published();
    if (newest >= slots && reader->read(newest - slots, frame, 0) == Outcome::kFrame &&
        !intact(frame, newest - slots)) {
      return kExitTorn;
    }
    switch (reader->read(next, frame, 30'000)) {
      case Outcome::kFrame:
        if (!intact(frame, next)) return kExitTorn;
        ++good;
        if (!frame.motion.empty()) ++moved;
        ++next;
        break;
      case Outcome::kOverwritten:
        next = std::max(next + 1, reader->published() - slots);
        break;
      case Outcome::kTimeout:
        return kExitUnreadable;
      case Outcome::kClosed:
        return good > 0 && (moved > 0) == (reader->header().motion_offset != 0) ? kExitGood : kExitUnreadable;
    }
  }
}

// Starts a process that follows the stream; returns once it has opened it.
pid_t start_follower(const std::string& name) {
  int ready[2];
  EXPECT_EQ(pipe(ready), 0);
  const pid_t child = fork();
  EXPECT_GE(child, 0);
  if (child == 0) _exit(follow(name, ready[1]));
  char byte = 0;
  EXPECT_EQ(read(ready[0], &byte, 1), 1);
  close(ready[0]);
  close(ready[1]);
  return child;
}

TEST(ShmStress, NoTornFrameIsAcceptedByAnotherProcess) {
  const std::string name = unique_name("stress");
  Writer writer(name, {127, 31});
  writer.format.motion = true;  // the motion of the same frame
  ASSERT_TRUE(writer.open());
  const pid_t readers[]{start_follower(name), start_follower(name)};
  for (std::uint64_t n = 0; n < kFrames; ++n) writer.publish();
  writer.sink.close();
  for (const pid_t child : readers) {
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status)) << "reader died of signal " << WTERMSIG(status);
    EXPECT_EQ(WEXITSTATUS(status), kExitGood) << "3: a torn frame, 4: nothing to read";
  }
}

TEST(ShmStress, AStoppedReaderNeverStopsTheWriter) {
  Stream stream("slow", {64, 16});
  const pid_t child = start_follower(stream.name);
  ASSERT_EQ(kill(child, SIGSTOP), 0);
  for (std::uint64_t n = 0; n < kFrames; ++n) stream.writer.publish();
  EXPECT_EQ(stream.writer.next, kFrames);
  ASSERT_EQ(kill(child, SIGKILL), 0);
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  ReadFrame frame;
  EXPECT_EQ(stream.reader->read(kFrames - 1, frame, 0), Outcome::kFrame);
}

// --- Many readers wait on the futex word: all of them wake up.

// Like ShmReader's wait, but without a timeout.
void wait_for_change(const std::uint32_t& word, std::uint32_t seen) {
  while (load_acquire(word) == seen) syscall(SYS_futex, &word, FUTEX_WAIT, seen, nullptr, nullptr, 0);
}

TEST(Waker, WakesAllOfAFewAndOfMany) {
  constexpr std::uint32_t kRounds = 100;
  for (const int readers : {1, 4, 5, 20}) {
    std::uint32_t word = 0;
    Waker waker(word);
    std::vector<std::jthread> threads;
    std::atomic<std::uint32_t> arrivals{0};
    for (int i = 0; i < readers; ++i) {
      threads.emplace_back([&] {
        for (std::uint32_t seen = 0; seen < kRounds; ++seen) {
          ++arrivals;
          wait_for_change(word, seen);
        }
      });
    }
    for (std::uint32_t round = 0; round < kRounds; ++round) {
      while (arrivals < (round + 1) * static_cast<std::uint32_t>(readers)) std::this_thread::yield();
      store_release(word, round + 1);
      waker.wake();
    }
    EXPECT_EQ(arrivals, kRounds * static_cast<std::uint32_t>(readers));
  }
}

TEST(Waker, ItsEndWakesWhoStillWaits) {
  std::uint32_t word = 0;
  auto waker = std::make_unique<Waker>(word);
  std::vector<std::jthread> threads;
  for (int i = 0; i < 8; ++i) threads.emplace_back([&] { wait_for_change(word, 0); });
  store_release(word, std::uint32_t{1});
  waker = nullptr;
}

}  // namespace bolo::shm::shm_stress_test
