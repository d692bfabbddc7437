// Logging to a sink that blocks, and the fields of a message in the journal.
#include "tools/bolod/log.hpp"
#include "tests/child.hpp"
#include "tests/no_threads.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <spdlog/logger.h>
#include <spdlog/sinks/base_sink.h>

namespace bolo::daemon::log_test {

// Accepts messages while open.
class Gate {
 public:
  void open() {
    const std::scoped_lock lock(mutex_);
    open_ = true;
    changed_.notify_all();
  }
  void take(std::string text) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return open_; });
    taken_.push_back(std::move(text));
    changed_.notify_all();
  }
  std::vector<std::string> taken(std::size_t at_least) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, std::chrono::minutes(1), [&] { return taken_.size() >= at_least; });
    return taken_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool open_ = false;
  std::vector<std::string> taken_;
};

class GateSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit GateSink(std::shared_ptr<Gate> gate) : gate_(std::move(gate)) {}

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    const pipeline::Notice* const notice = notice_on_this_thread();
    gate_->take(std::string(message.payload.data(), message.payload.size()) +
                (notice != nullptr ? " " + std::string(notice->event) : ""));
  }
  void flush_() override {}

 private:
  const std::shared_ptr<Gate> gate_;
};

TEST(QueuedSink, LoggingNeverWaitsAndTellsWhatWasDropped) {
  const auto gate = std::make_shared<Gate>();
  constexpr std::size_t kMost = 4;
  spdlog::logger log("test", make_queued_sink(std::make_shared<GateSink>(gate), kMost));
  for (int i = 0; i < 100; ++i) log.info("message {}", i);  // does not block although nothing is accepted
  EXPECT_TRUE(gate->taken(0).empty());
  gate->open();
  // Messages already taken from the queue arrive besides the queued ones; the number dropped comes last.
  std::vector<std::string> taken;
  do {
    const std::size_t wanted = taken.size() + 1;
    taken = gate->taken(wanted);
    ASSERT_GE(taken.size(), wanted) << "no count came";
  } while (taken.back().find(" messages were dropped") == std::string::npos);
  ASSERT_GE(taken.size(), kMost + 1);
  for (std::size_t i = 0; i + 1 < kMost; ++i) EXPECT_EQ(taken[i], "message " + std::to_string(i));
  const std::string& last = taken.back();
  EXPECT_EQ(std::stoul(last) + taken.size() - 1, 100U) << "each is written or counted";
}

TEST(QueuedSink, ANoticeGoesWithItsMessage) {
  const auto gate = std::make_shared<Gate>();
  gate->open();
  spdlog::logger log("test", make_queued_sink(std::make_shared<GateSink>(gate)));
  log_notice(log, spdlog::level::warn, {true, "gone", pipeline::event::kCameraLost});
  log.info("the next");
  EXPECT_EQ(gate->taken(2), (std::vector<std::string>{"gone camera_lost", "the next"}));
}

TEST(QueuedSink, WithoutAThreadWhoLogsWrites) {
  const auto gate = std::make_shared<Gate>();
  gate->open();
  spdlog::logger log("test", make_queued_sink(std::make_shared<GateSink>(gate), 1000, std::chrono::minutes(1)));
  {
    const NoThreads none;
    log_notice(log, spdlog::level::warn, {true, "gone", pipeline::event::kCameraLost});
    EXPECT_EQ(gate->taken(0), std::vector<std::string>{"gone camera_lost"});
  }
  log.info("the next");
  EXPECT_EQ(gate->taken(2), (std::vector<std::string>{"gone camera_lost", "the next"}));
}

TEST(QueuedSink, ItsEndWritesWhatIsLeftAndDoesNotWaitForEver) {
  const auto open = std::make_shared<Gate>();
  open->open();
  {
    spdlog::logger log("test", make_queued_sink(std::make_shared<GateSink>(open), 1000, std::chrono::minutes(1)));
    for (int i = 0; i < 500; ++i) log.info("{}", i);
  }
  EXPECT_EQ(open->taken(0).size(), 500U);
  const auto gate = std::make_shared<Gate>();
  {
    spdlog::logger log("test", make_queued_sink(std::make_shared<GateSink>(gate), 10, std::chrono::milliseconds(20)));
    log.info("into nothing");
  }
  gate->open();  // lets the thread end
  EXPECT_EQ(gate->taken(1).size(), 1U);
}

// A thread blocked in the sink must not hold locks that are needed at exit.
TEST(TextLog, APipeThatNobodyReadsKeepsNoProgramFromItsEnd) {
  const int ended = in_child([] {
    std::array<int, 2> pipe_ends{};
    if (pipe2(pipe_ends.data(), O_NONBLOCK) != 0) return 1;
    while (write(pipe_ends[1], "full", 4) == 4) {
    }
    fcntl(pipe_ends[1], F_SETFL, 0);
    dup2(pipe_ends[1], STDERR_FILENO);
    alarm(30);
    make_log({.format = LogFormat::kText}, "front")->info("into nothing");
    write_to_stderr("nor this", 10);
    std::exit(0);
    return 1;
  });
  EXPECT_EQ(ended, 0);
}

using Fields = std::vector<std::string>;

class JournalSinkTest : public testing::Test {
 protected:
  JournalSinkTest()
      : log_("bolod", make_journal_sink("front", [this](const std::vector<iovec>& fields) {
               sent_.clear();
               for (const iovec& one : fields) sent_.emplace_back(static_cast<const char*>(one.iov_base), one.iov_len);
               return answer_;
             })) {
    log_.set_level(spdlog::level::debug);
  }
  bool has(const std::string& field) const { return std::find(sent_.begin(), sent_.end(), field) != sent_.end(); }

  int answer_ = 0;
  Fields sent_;
  spdlog::logger log_;
};

TEST_F(JournalSinkTest, AMessageHasItsPriorityAndTheDaemonsName) {
  log_.warn("memory = locked");
  EXPECT_EQ(sent_, (Fields{"MESSAGE=memory = locked", "PRIORITY=4", "SYSLOG_IDENTIFIER=bolod", "BOLO_NAME=front"}));
  for (const auto& [level, priority] : {std::pair{spdlog::level::err, "PRIORITY=3"},
                                        {spdlog::level::info, "PRIORITY=6"},
                                        {spdlog::level::debug, "PRIORITY=7"}}) {
    log_.log(level, "x");
    EXPECT_TRUE(has(priority));
  }
}

// Cameras and files contribute text: `journalctl -o cat` shows it as it is, and a line break would be another message.
TEST_F(JournalSinkTest, AMessageIsOnePrintableLineOfABoundedLength) {
  log_.warn("camera\nNov 30 bolod: all is well\x1b[2J\xff");
  EXPECT_EQ(sent_.front(), "MESSAGE=camera?Nov 30 bolod: all is well?[2J?");
  log_.warn("begin " + std::string(1'000'000, 'x') + " end");
  EXPECT_LE(sent_.front().size(), 2100U);
  EXPECT_TRUE(sent_.front().starts_with("MESSAGE=begin xxx")) << sent_.front();
  EXPECT_TRUE(sent_.front().ends_with("xxx end")) << sent_.front();
}

TEST_F(JournalSinkTest, ANoticeHasItsEventAndItsCounts) {
  log_notice(log_, spdlog::level::warn,
             {true, "frames lost", pipeline::event::kFramesLost, {{"lost_missing", 3}, {"lost_queue_full", 1}}});
  EXPECT_TRUE(has("BOLO_EVENT=frames_lost"));
  EXPECT_TRUE(has("BOLO_LOST_MISSING=3"));
  EXPECT_TRUE(has("BOLO_LOST_QUEUE_FULL=1"));
  log_.info("the next message");
  EXPECT_EQ(sent_.size(), 4U) << "has nothing of the notice";
}

TEST_F(JournalSinkTest, WhatTheJournalRefusesIsOnStandardError) {
  answer_ = -1;
  testing::internal::CaptureStderr();
  log_.warn("camera lost");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "<4>camera lost\n");
}

TEST(StderrIsJournal, OnlyWhenTheVariableNamesThisVeryFile) {
  unsetenv("JOURNAL_STREAM");
  EXPECT_FALSE(stderr_is_journal());
  struct stat there {};
  ASSERT_EQ(fstat(STDERR_FILENO, &there), 0);
  for (const ino_t off : {0U, 1U}) {
    setenv("JOURNAL_STREAM", (std::to_string(there.st_dev) + ":" + std::to_string(there.st_ino + off)).c_str(), 1);
    EXPECT_EQ(stderr_is_journal(), off == 0);
  }
  unsetenv("JOURNAL_STREAM");
}

}  // namespace bolo::daemon::log_test
