#include "tools/cluster/job_folder.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/scratch.hpp"
#include "tools/cluster/digest.hpp"

namespace bolo::tools::cluster {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

Json plan(double lambda = 0.1) { return {{"bolo_job", 1}, {"settings", {{"lambda", lambda}, {"solver", "admm"}}}}; }

std::string contents(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

void write(const fs::path& file, const std::string& text) { std::ofstream(file) << text; }

TEST(Digest, IsSha256) {
  // FIPS 180-2, appendix B.1.
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  const Scratch folder;
  write(folder / "abc", "abc");
  EXPECT_EQ(*sha256_of(folder / "abc"), sha256("abc"));
  EXPECT_EQ(sha256_of(folder / "none").error().kind, ErrorKind::kBadInput);
}

TEST(JobFolder, KeepsRecordsBitForBit) {
  const Scratch folder;
  const auto job = JobFolder::open(folder / "job", plan());
  ASSERT_TRUE(job) << job.error().message;
  EXPECT_FALSE(job->record("a"));
  const Json record{{"sum", 0.1 + 0.2}, {"frames", {1, 2, 3}}, {"text", "line\n\"two\""}};
  ASSERT_TRUE(job->add_record("a", record));
  const auto again = JobFolder::open(folder / "job", plan());
  ASSERT_TRUE(again);
  auto read = again->record("a");
  ASSERT_TRUE(read);
  EXPECT_EQ(read->at("by"), own_name());
  for (const auto& [key, value] : record.items()) EXPECT_EQ(read->at(key), value) << key;
  again->forget("a");
  EXPECT_FALSE(job->record("a"));
}

TEST(JobFolder, OfOtherWorkIsRefusedWithWhatDiffers) {
  const Scratch folder;
  ASSERT_TRUE(JobFolder::open(folder / "job", plan(0.1)));
  const auto other = JobFolder::open(folder / "job", plan(0.5));
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(other.error().message.find("/settings/lambda is 0.1 there and 0.5 now"), std::string::npos)
      << other.error().message;
  EXPECT_TRUE(JobFolder::open(folder / "job", plan(0.1)));
}

TEST(JobFolder, WithoutAReadablePlanIsRefused) {
  const Scratch folder;
  ASSERT_TRUE(JobFolder::open(folder / "job", plan()));
  write(folder / "job" / "plan.json", R"({"bolo_job")");
  const auto job = JobFolder::open(folder / "job", plan());
  ASSERT_FALSE(job);
  EXPECT_NE(job.error().message.find("is no plan"), std::string::npos) << job.error().message;
}

TEST(JobFolder, WhereNoFolderCanBeIsRefused) {
  const Scratch folder;
  write(folder / "file", "x");
  const auto job = JobFolder::open(folder / "file", plan());
  ASSERT_FALSE(job);
  EXPECT_EQ(job.error().kind, ErrorKind::kBadInput);
}

// A record that is cut off anywhere, or has any other byte in it, counts for nothing.
TEST(JobFolder, ATornOrChangedRecordIsNone) {
  const Scratch folder;
  const auto job = JobFolder::open(folder / "job", plan());
  ASSERT_TRUE(job);
  ASSERT_TRUE(job->add_record("a", {{"bytes", 1234}, {"crc", 77}}));
  const fs::path file = folder / "job" / "done" / "a.json";
  const std::string whole = contents(file);
  for (std::size_t size = 0; size + 1 < whole.size(); ++size) {  // the last byte is the end of the line
    write(file, whole.substr(0, size));
    EXPECT_FALSE(job->record("a")) << size;
  }
  for (std::size_t i = 0; i + 1 < whole.size(); ++i) {
    std::string changed = whole;
    changed[i] = changed[i] == '7' ? '8' : '7';
    write(file, changed);
    EXPECT_FALSE(job->record("a")) << i << ": " << changed;
  }
  write(file, whole);
  EXPECT_TRUE(job->record("a"));
}

TEST(JobFolder, ARecordOfAnotherPlanIsNone) {
  const Scratch folder;
  const auto one = JobFolder::open(folder / "one", plan(0.1));
  const auto other = JobFolder::open(folder / "other", plan(0.5));
  ASSERT_TRUE(one && other);
  ASSERT_TRUE(one->add_record("a", {{"bytes", 1}}));
  fs::copy(folder / "one" / "done" / "a.json", folder / "other" / "done" / "a.json");
  EXPECT_FALSE(other->record("a"));
}

TEST(JobFolder, OfManyWhoComeAtOnceIsTheirsIfTheyWantTheSame) {
  const Scratch folder;
  std::vector<int> refused(16, 0);
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < refused.size(); ++i) {
      threads.emplace_back([&, i] { refused[i] = JobFolder::open(folder / "job", plan()) ? 0 : 1; });
    }
  }
  EXPECT_EQ(refused, std::vector<int>(16, 0));
  EXPECT_EQ(*JobFolder::plan_in(folder / "job"), plan());
}

TEST(JobFolder, ClearsWhatProcessesLeft) {
  const Scratch folder;
  const auto job = JobFolder::open(folder / "job", plan());
  ASSERT_TRUE(job);
  write(job->unfinished("a.h5"), "half");
  write(job->data("b"), "planes");
  ASSERT_TRUE(job->add_record("a", {}));
  job->clear_data();
  EXPECT_TRUE(fs::is_empty(folder / "job" / "data"));
  EXPECT_TRUE(job->record("a"));
}

TEST(Publish, GivesAFileItsNameAndReplacesAnother) {
  const Scratch folder;
  write(folder / "own", "new");
  write(folder / "name", "old");
  ASSERT_TRUE(publish(folder / "own", folder / "name"));
  EXPECT_EQ(contents(folder / "name"), "new");
  EXPECT_FALSE(fs::exists(folder / "own"));
  const Status missing = publish(folder / "none", folder / "name");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().kind, ErrorKind::kFailed);
}

}  // namespace
}  // namespace bolo::tools::cluster
