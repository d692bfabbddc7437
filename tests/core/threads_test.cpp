// Work shared out among threads, also when the system gives no thread, and the message about it.
#include "src/core/threads.hpp"
#include "tests/no_threads.hpp"

namespace bolo::threads_test {

std::vector<int> times_done(std::size_t count, std::size_t threads) {
  std::vector<int> times(count);
  share_out(count, threads, [&](std::size_t i) { ++times[i]; });
  return times;
}

TEST(ShareOut, DoesEachOnceWithAsManyThreadsAsThereAre) {
  for (const std::size_t threads : {0U, 1U, 3U, 200U}) EXPECT_EQ(times_done(100, threads), std::vector<int>(100, 1));
  EXPECT_TRUE(times_done(0, 4).empty());
  const NoThreads none;
  EXPECT_EQ(times_done(100, 4), std::vector<int>(100, 1));
}

TEST(ShareOut, ThrowsWhatTheWorkThrowsOnAnyThread) {
  const auto refuse = [](std::size_t i) {
    if (i % 7 == 3) throw std::bad_alloc();
    std::this_thread::yield();
  };
  for (int round = 0; round < 20; ++round) EXPECT_THROW(share_out(100, 4, refuse), std::bad_alloc);
}

TEST(WordsOf, SayWhatTheSystemRefuses) {
  EXPECT_EQ(describe_exception(std::bad_alloc()), "not enough memory");
  EXPECT_EQ(describe_exception(std::runtime_error("other")), "other");
  EXPECT_EQ(describe_exception(std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again))),
            "no thread can be started: raise 'ulimit -u', or TasksMax= of the systemd unit");
  const NoThreads none;
  try {
    std::thread([] {}).join();
    FAIL() << "a thread was started";
  } catch (const std::exception& e) {
    EXPECT_EQ(describe_exception(e), "no thread can be started: not enough memory for its stack");
  }
}

}  // namespace bolo::threads_test
