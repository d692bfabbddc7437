// `bolo-lab blind` in a job folder: interrupted, in shards, as ranks; against one process that does it all.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <regex>
#include <set>
#include <thread>

#include <nlohmann/json.hpp>

#include "tests/scratch.hpp"
#include "tests/tools/program.hpp"
#include "tools/cluster/digest.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::contents;
using test::Outcome;
using test::Program;
using Words = std::vector<std::string>;

constexpr std::size_t kSessions = 12;
constexpr const char* kMpirun = "/usr/bin/mpirun";

// Without what differs from run to run.
json timeless(const std::string& text) {
  json score = json::parse(text, nullptr, false);
  EXPECT_FALSE(score.is_discarded()) << text;
  EXPECT_EQ(score.erase("seconds"), 1U);
  EXPECT_EQ(score.erase("sealed_sha256"), 1U);
  for (json& kind : score["kinds"]) EXPECT_EQ(kind.erase("seconds"), 1U);
  return score;
}

std::string timeless_page(const fs::path& file) {
  std::string page = contents(file);
  page = std::regex_replace(page, std::regex("; [0-9]+ s in all"), "");
  page = std::regex_replace(page, std::regex("[0-9a-f]{64}"), "");
  return std::regex_replace(page, std::regex("<td class=n>[0-9.]+</tr>"), "");  // seconds of a kind
}

class BlindShared : public testing::Test {
 protected:
  BlindShared() { fs::create_directory(tmp_); }

  // Two sessions of each kind; its temporary files are under tmp_, and it stands in the scratch folder.
  Words blind(const Words& more) const {
    Words words{BOLO_PROGRAM, "blind",          "--bolo", BOLO_PROGRAM, "--width", "8",     "--height",
                "8",          "--frames-scale", "0.1",    "--sessions", "2",       "--json"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  Program start(const Words& more) const {
    Words words{"/usr/bin/env", "-C", scratch_.path().string(), "TMPDIR=" + tmp_.string()};
    const Words verb = blind(more);
    words.insert(words.end(), verb.begin(), verb.end());
    return {scratch_.path(), words};
  }

  Outcome run(const Words& more) const { return start(more).outcome(); }

  std::string path(const std::string& name) const { return (scratch_ / name).string(); }
  void order(const std::string& what) const { std::ofstream(tmp_ / what) << "x"; }

  std::size_t records(const std::string& job = "job") const {
    std::error_code none;
    const fs::directory_iterator folder(scratch_ / job / "done", none);
    return static_cast<std::size_t>(std::distance(folder, fs::directory_iterator()));
  }

  // Until so many sessions are recorded; false after half a minute.
  bool wait_for_records(std::size_t count) const {
    for (int i = 0; i < 6000 && records() < count; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return records() >= count;
  }

  json whole() const {
    const Outcome outcome = run({"--html", path("whole.html")});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return timeless(outcome.out);
  }

  const Scratch scratch_;
  const fs::path tmp_ = scratch_ / "tmp";
};

TEST_F(BlindShared, ThreeShardsAreTheWhole) {
  const json whole = this->whole();
  std::string digest;
  for (int i = 1; i <= 3; ++i) {
    const Outcome outcome = run({"--job", "job", "--shard", std::to_string(i) + "/3", "--html", path("shards.html"),
                                 "--keep", path("kept"), "--jobs", i == 2 ? "2" : "1"});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const json said = json::parse(outcome.out);
    if (i == 1) digest = said.at("sealed_sha256");
    EXPECT_EQ(said.at("sealed_sha256"), digest);
    EXPECT_NE(outcome.err.find("sealed 12 answers: sha256 " + digest), std::string::npos) << outcome.err;
    EXPECT_EQ(records(), static_cast<std::size_t>(4 * i));
    EXPECT_EQ(fs::exists(path("kept/answers.json")), i == 3);
    EXPECT_EQ(fs::exists(path("shards.html")), i == 3);
    if (i == 3) {
      EXPECT_EQ(timeless(outcome.out), whole);
    } else {
      EXPECT_EQ(said.at("left"), kSessions - records());
    }
  }
  EXPECT_EQ(timeless_page(path("shards.html")), timeless_page(path("whole.html")));
  EXPECT_EQ(cluster::sha256(contents(path("kept/answers.json")) + contents(path("kept/nonce.txt"))), digest);
  for (const char* kept : {"effect-free-0", "pair-1", "forms-1"}) {
    EXPECT_TRUE(fs::exists(scratch_ / "kept" / kept / "report" / "report.html")) << kept;
  }
}

TEST_F(BlindShared, GoesOnWhereItWasInterrupted) {
  const json whole = this->whole();
  order("hold");
  const Program first = start({"--job", "job"});
  ASSERT_TRUE(wait_for_records(8)) << "all before the withheld ones, where two at a time are held";
  first.signal(SIGINT);
  const Outcome interrupted = first.outcome();
  EXPECT_EQ(interrupted.exit_code, 1);
  EXPECT_NE(interrupted.err.find("the same command goes on"), std::string::npos) << interrupted.err;
  EXPECT_EQ(records(), 8U);

  const Program second = start({"--job", "job"});
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  second.signal(SIGKILL);
  EXPECT_EQ(second.outcome().exit_code, -1);
  EXPECT_EQ(records(), 8U);

  fs::remove(tmp_ / "hold");
  const Outcome last = run({"--job", "job", "--html", path("resumed.html")});
  ASSERT_EQ(last.exit_code, 0) << last.err;
  EXPECT_NE(last.err.find("4 sessions done in"), std::string::npos) << last.err;
  EXPECT_NE(last.err.find(", 8 done before"), std::string::npos) << last.err;
  EXPECT_EQ(timeless(last.out), whole);
  EXPECT_EQ(timeless_page(path("resumed.html")), timeless_page(path("whole.html")));
  const std::string digest = json::parse(last.out).at("sealed_sha256");
  EXPECT_NE(interrupted.err.find(digest), std::string::npos) << "published before, and the same";

  const Outcome again = run({"--job", "job"});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_NE(again.err.find("0 sessions done in"), std::string::npos) << again.err;
  const json all = json::parse(again.out);
  EXPECT_EQ(all.at("kinds"), json::parse(last.out).at("kinds")) << "times are recorded too";
}

TEST_F(BlindShared, TheChildIsToldNothingOfTheJob) {
  const Outcome outcome = run({"--job", "secret-job", "--kind", "single", "--seed", "424242", "--keep", path("kept")});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::string seen = contents(scratch_ / "kept/single-0/seen.txt");
  ASSERT_NE(seen.find("cwd " + path("kept") + "/bolo-"), std::string::npos) << seen;
  for (const char* hint : {"secret-job", "single", "424242", "nonce", "plan.json"}) {
    EXPECT_EQ(seen.find(hint), std::string::npos) << hint << " in\n" << seen;
  }
  // Nor can it read it in the folders that it knows, as seen from here.
  EXPECT_EQ(contents(scratch_ / "kept/nonce.txt") + "\n", contents(scratch_ / "secret-job/nonce"));
}

TEST_F(BlindShared, ABrokenDiagnosisIsRecordedAndNotTriedAgain) {
  order("break");
  const Outcome one = run({});
  EXPECT_EQ(one.exit_code, 1);
  const Outcome broken = run({"--job", "job"});
  EXPECT_EQ(broken.exit_code, 1);
  const json score = timeless(broken.out);
  EXPECT_EQ(score, timeless(one.out));
  EXPECT_EQ(score.at("kinds").at("withheld").at("broken"), 2);
  EXPECT_NE(broken.out.find("the diagnosis ended with exit code 2: bolo diagnose: made up \xEF\xBF\xBD"),
            std::string::npos)
      << broken.out;
  EXPECT_NE(broken.err.find("2 diagnoses broke"), std::string::npos) << broken.err;
  EXPECT_NE(broken.err.find("job/done/withheld-00000.json"), std::string::npos) << broken.err;
  EXPECT_EQ(records(), kSessions);

  fs::remove(tmp_ / "break");
  const Outcome again = run({"--job", "job"});
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_NE(again.err.find("0 sessions done in"), std::string::npos) << again.err;
  EXPECT_EQ(timeless(again.out), score);

  for (const char* name : {"withheld-00000.json", "withheld-00001.json"}) fs::remove(scratch_ / "job/done" / name);
  const Outcome mended = run({"--job", "job"});
  EXPECT_EQ(mended.exit_code, 0) << mended.err;
  EXPECT_EQ(timeless(mended.out), whole());
}

TEST_F(BlindShared, WhatTheDiskRefusesIsNotRecorded) {
  fs::remove(tmp_);
  const Outcome outcome = run({"--job", "job", "--kind", "single"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_NE(outcome.err.find("TMPDIR"), std::string::npos) << outcome.err;
  EXPECT_NE(outcome.err.find("(single-00001)"), std::string::npos) << outcome.err;
  EXPECT_EQ(json::parse(outcome.out).at("left"), 2);
  EXPECT_EQ(records(), 0U);
  fs::create_directory(tmp_);
  EXPECT_EQ(run({"--job", "job", "--kind", "single"}).exit_code, 0);
}

TEST_F(BlindShared, ASessionThatIsToBeKeptIsDoneAgain) {
  ASSERT_EQ(run({"--job", "job", "--kind", "single"}).exit_code, 0);
  const Outcome kept = run({"--job", "job", "--kind", "single", "--keep", path("kept")});
  ASSERT_EQ(kept.exit_code, 0) << kept.err;
  EXPECT_NE(kept.err.find("2 sessions done in"), std::string::npos) << kept.err;
  EXPECT_TRUE(fs::exists(scratch_ / "kept/single-1/capture-1.h5"));
}

TEST_F(BlindShared, WordsThatDoNotGoTogetherAreRefused) {
  for (const Words& words : std::vector<Words>{{"--shard", "1/2"},
                                               {"--job", ""},
                                               {"--job", "job", "--shard", "3/2"},
                                               {"--job", "job", "--rank-timeout", "0"}}) {
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.exit_code, 2) << words[0] << ' ' << words[1];
    EXPECT_NE(outcome.err.find("bolo-lab blind: "), std::string::npos) << outcome.err;
  }
  ASSERT_EQ(run({"--job", "job", "--kind", "single"}).exit_code, 0);
  const Outcome other = run({"--job", "job", "--kind", "single", "--magnitude", "0.5"});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("/draw/magnitude is 1.0 there and 0.5 now"), std::string::npos) << other.err;
}

class BlindRanks : public BlindShared {
 protected:
  void SetUp() override {
    if (!fs::exists(kMpirun)) GTEST_SKIP() << "no mpirun: install openmpi-bin";
    if (!fs::exists(fs::path(BOLO_PROGRAM).parent_path() / "bolo-mpi.so")) {
      GTEST_SKIP() << "built without MPI (libopenmpi-dev), or under a sanitizer";
    }
    setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
    setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);
  }

  Outcome ranks(const Words& more) const {
    Words words{kMpirun, "--oversubscribe", "-n", "2"};
    const Words verb = blind(more);
    words.insert(words.end(), verb.begin(), verb.end());
    return Program(scratch_.path(), words).outcome();
  }
};

TEST_F(BlindRanks, AreTheWhole) {
  const json whole = this->whole();
  const Outcome outcome = ranks({"--job", path("job"), "--html", path("ranks.html"), "--keep", path("kept")});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(timeless(outcome.out), whole);
  EXPECT_EQ(timeless_page(path("ranks.html")), timeless_page(path("whole.html")));
  EXPECT_NE(outcome.err.find("2 ranks on 1 hosts"), std::string::npos) << outcome.err;
  std::set<std::string> by;
  for (const auto& entry : fs::directory_iterator(scratch_ / "job/done")) {
    by.insert(json::parse(contents(entry.path())).at("by").get<std::string>());
  }
  EXPECT_EQ(by.size(), 2U) << "both had a part";
  const std::size_t sealed = outcome.err.find("sealed 12 answers");
  EXPECT_NE(sealed, std::string::npos) << outcome.err;
  EXPECT_EQ(outcome.err.find("sealed 12 answers", sealed + 1), std::string::npos) << "once";
  const std::string seen = contents(scratch_ / "kept/single-0/seen.txt");
  EXPECT_NE(seen.find("capture-1.h5"), std::string::npos);
  for (const char* hint : {"OMPI", "PMIX", "single"}) EXPECT_EQ(seen.find(hint), std::string::npos) << hint;
}

TEST_F(BlindRanks, NeedAFolderAndDoOneSessionAtATime) {
  const Outcome none = ranks({});
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_NE(none.err.find("give --job FOLDER, which all see"), std::string::npos) << none.err;
  const Outcome many = ranks({"--job", path("job"), "--jobs", "2"});
  EXPECT_EQ(many.exit_code, 2);
  EXPECT_NE(many.err.find("--jobs 2: a rank does one session at a time"), std::string::npos) << many.err;
  const Outcome shard = ranks({"--job", path("job"), "--shard", "1/2"});
  EXPECT_EQ(shard.exit_code, 2);
}

}  // namespace
}  // namespace bolo::tools
