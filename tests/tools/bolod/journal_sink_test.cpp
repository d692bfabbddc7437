// The fields of a message on their way into the journal.
#include "tools/bolod/log.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>

namespace bolo::daemon::journal_sink_test {
namespace {

using Fields = std::vector<std::string>;

// A logger whose journal is a list.
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
  log_.warn("memory is not locked");
  EXPECT_EQ(sent_,
            (Fields{"MESSAGE=memory is not locked", "PRIORITY=4", "SYSLOG_IDENTIFIER=bolod", "BOLO_NAME=front"}));
  log_.error("x");
  EXPECT_TRUE(has("PRIORITY=3"));
  log_.info("x");
  EXPECT_TRUE(has("PRIORITY=6"));
  log_.debug("x");
  EXPECT_TRUE(has("PRIORITY=7"));
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

TEST_F(JournalSinkTest, ATextKeepsItsLinesAndItsEqualSigns) {
  log_.info("a = b\nc");
  EXPECT_TRUE(has("MESSAGE=a = b\nc"));
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
  setenv("JOURNAL_STREAM", (std::to_string(there.st_dev) + ":" + std::to_string(there.st_ino)).c_str(), 1);
  EXPECT_TRUE(stderr_is_journal());
  setenv("JOURNAL_STREAM", (std::to_string(there.st_dev) + ":" + std::to_string(there.st_ino + 1)).c_str(), 1);
  EXPECT_FALSE(stderr_is_journal());
  unsetenv("JOURNAL_STREAM");
}

}  // namespace
}  // namespace bolo::daemon::journal_sink_test
