#include "tools/lab/blind/blind.hpp"

#include <atomic>
#include <fstream>

#include <gtest/gtest.h>

#include "tests/scratch.hpp"

namespace bolo::tools::blind::child_test {
namespace {

// A program of one shell line in `folder`.
ChildWork work_of(const Scratch& folder, const std::string& line) {
  const auto program = folder / "program";
  std::ofstream(program) << "#!/bin/sh\n" << line << '\n';
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
  return {program, {folder / "capture-1.h5"}, folder / "report", "", 60.0};
}

const std::atomic<bool> kNever{false};

TEST(BlindChild, GetsTheWordsOfADiagnosis) {
  const Scratch folder;
  ChildWork work = work_of(folder, "echo \"$@\" >&2");
  work.withheld = "iir";
  ASSERT_TRUE(run_child(work, kNever));
  std::string said;
  std::getline(std::ifstream(folder / "diagnose.err") >> std::ws, said);
  EXPECT_EQ(said, "diagnose -o " + (folder / "report").string() + " --threads 1 --withhold iir " +
                      (folder / "capture-1.h5").string());
}

TEST(BlindChild, SaysWhyItFailed) {
  const Scratch folder;
  const Status status = run_child(work_of(folder, "echo nonsense >&2; exit 3"), kNever);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message, "the diagnosis ended with exit code 3: nonsense");
  const Scratch other;
  const Status killed = run_child(work_of(other, "kill -9 $$"), kNever);
  ASSERT_FALSE(killed);
  EXPECT_EQ(killed.error().message, "the diagnosis ended with signal 9");
}

TEST(BlindChild, AProgramThatIsNotThereIsAnError) {
  const Scratch folder;
  ChildWork work = work_of(folder, "");
  work.program = folder / "nothing";
  EXPECT_FALSE(run_child(work, kNever));
}

TEST(BlindChild, IsEndedWhenItTakesTooLongOrIsNotWanted) {
  const Scratch folder;
  ChildWork work = work_of(folder, "exec sleep 300");
  work.limit_s = 0.2;
  const Status late = run_child(work, kNever);
  ASSERT_FALSE(late);
  EXPECT_EQ(late.error().message, "the diagnosis took too long");
  work.limit_s = 300.0;
  const Status stopped = run_child(work, std::atomic<bool>{true});
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().message, "interrupted");
}

}  // namespace
}  // namespace bolo::tools::blind::child_test
