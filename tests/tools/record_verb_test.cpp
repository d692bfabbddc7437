// `bolo record` and `bolo recover` as their users meet them; the daemon is a writer of shared memory fed by the test.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <thread>

#include <nlohmann/json.hpp>

#include "src/capture/capture.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::Outcome;
using test::Program;

constexpr auto kHangGuard = std::chrono::seconds(60);

class RecordVerb : public test::ProgramTest {
 protected:
  RecordVerb() : ProgramTest({BOLO_PROGRAM}) {}
  void SetUp() override { name_ = shm::unique_name(testing::UnitTest::GetInstance()->current_test_info()->name()); }

  std::string name_;
};

// Publishes at some 500 frames a second until `enough`.
template <typename Enough>
void publish_until(shm::Writer& writer, Enough enough) {
  const auto begin = std::chrono::steady_clock::now();
  while (!enough() && std::chrono::steady_clock::now() - begin < kHangGuard) {
    writer.publish();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

bool exists(const std::string& file) { return fs::exists(file); }

void expect_published(const capture::CaptureReader& reader, std::size_t plane_index) {
  std::vector<std::uint16_t> plane(reader.info().format.geometry.pixels());
  for (std::size_t i = 0; i < reader.info().frames; ++i) {
    const std::uint64_t number = reader.frame_id()[i] / 2;
    ASSERT_TRUE(reader.read_frame(i, plane.data()));
    for (std::size_t p = 0; p < plane.size(); ++p) ASSERT_EQ(plane[p], shm::pattern(number, plane_index, p));
    ASSERT_NEAR(reader.t()[i], static_cast<double>(number) * 0.005, 1e-9);
  }
}

capture::CaptureReader opened(const std::string& file) {
  auto reader = capture::CaptureReader::open(file);
  if (!reader) throw std::runtime_error(reader.error().message);
  return std::move(*reader);
}

// A capture of this many frames, as they were published.
void expect_recorded(const std::string& file, std::size_t frames, std::size_t plane_index = 0) {
  const capture::CaptureReader reader = opened(file);
  EXPECT_EQ(reader.info().frames, frames) << file;
  expect_published(reader, plane_index);
}

TEST_F(RecordVerb, SeveralCamerasGoIntoOneFolder) {
  shm::Writer left(name_ + "-l");
  shm::Writer right(name_ + "-r");
  ASSERT_TRUE(left.open());
  ASSERT_TRUE(right.open());
  Program program = start({"record", name_ + "-l", name_ + "-r", "-o", file("rig"), "--frames", "100", "--json"});
  const std::string files[] = {file("rig/" + name_ + "-l.h5"), file("rig/" + name_ + "-r.h5")};
  publish_until(left, [&] {
    right.publish();
    return exists(files[0]) && exists(files[1]);
  });
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  for (const std::string& one : files) {
    EXPECT_NE(outcome.out.find(one), std::string::npos) << outcome.out;
    expect_recorded(one, 100);
  }
  refused({"record", name_ + "-l", name_ + "-l", "-o", file("rig")}, "is named twice");
  refused({"record", name_ + "-l", name_ + "-r", "-o", file("rig.h5")}, "into a folder");
}

TEST_F(RecordVerb, AnInterruptEndsAllInGoodOrder) {
  shm::Writer left(name_ + "-l");
  ASSERT_TRUE(left.open());
  // One that is not there costs the other nothing, and is told.
  Program program = start({"record", name_ + "-l", name_ + "-none", "-o", file("rig")});
  const std::string recorded = file("rig/" + name_ + "-l.h5");
  publish_until(left, [&] { return exists(recorded + ".part") && program.err().find("-none") != std::string::npos; });
  int frames = 0;
  publish_until(left, [&] { return ++frames > 100; });
  program.signal(SIGINT);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
  EXPECT_TRUE(exists(recorded)) << outcome.err;
}

TEST_F(RecordVerb, StatShowsAllThatRun) {
  shm::Writer left(name_ + "-l");
  shm::Writer right(name_ + "-r");
  ASSERT_TRUE(left.open());
  ASSERT_TRUE(right.open());
  std::map<std::string, std::string> state;
  std::istringstream lines(run({"stat", "--once", "--json", "--interval", "0.1"}).out);
  for (std::string line; std::getline(lines, line);) {
    const json row = json::parse(line);
    state[row["name"]] = row["state"];
  }
  EXPECT_TRUE(state.contains(name_ + "-l") && state.contains(name_ + "-r")) << state.size();
  const Outcome table = run({"stat", "--once", "--interval", "0.1"});
  EXPECT_EQ(table.exit_code, 0) << table.err;
  EXPECT_TRUE(table.out.starts_with("camera ")) << table.out;
  EXPECT_GE(std::ranges::count(table.out, '\n'), 3) << table.out;
}

TEST_F(RecordVerb, FramesAreThePublishedOnes) {
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  Program program = start({"record", name_, "-o", file("a.h5"), "--frames", "300", "--json"});
  publish_until(writer, [&] { return exists(file("a.h5")); });
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json told = json::parse(outcome.out);
  EXPECT_EQ(told["frames"], 300);
  EXPECT_EQ(told["lost"]["overwritten"], 0);
  EXPECT_EQ(told["lost"]["no_room"], 0);
  const capture::CaptureReader reader = opened(file("a.h5"));
  ASSERT_EQ(reader.info().frames, 300U);
  EXPECT_EQ(reader.info().camera_model, "Model");
  EXPECT_EQ(reader.info().camera_serial, "1234");
  EXPECT_EQ(reader.info().format.scale.offset, 5.0);
  expect_published(reader, 0);
  EXPECT_FALSE(reader.info().has_motion);
  const std::string info = run({"info", file("a.h5")}).out;
  EXPECT_TRUE(std::regex_search(
      info, std::regex("recorded   20[0-9-]{8}T[0-9:]{8}\\.[0-9]{3}Z on [^ ]+ by bolo [0-9]+\\.[0-9.]+\n")))
      << info;
  EXPECT_NE(info.find(" uint16, 1.495 s, "), std::string::npos) << info;
  EXPECT_FALSE(exists(file("a.h5") + ".part")) << "renamed";
  EXPECT_FALSE(exists(file("a.h5") + ".part.journal"));
  EXPECT_FALSE(exists(file("a.h5") + ".part.live"));
}

// Somebody sets the clock in the middle of it, by an hour, and later back by more.
TEST_F(RecordVerb, UtcIsRecordedAndAStepOfTheClockIsSaid) {
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  constexpr std::int64_t kHour = 3'600'000'000'000;
  Program program = start({"record", name_, "-o", file("a.h5"), "--frames", "300"});
  std::uint64_t ahead = 0;
  std::uint64_t back = 0;
  publish_until(writer, [&] {
    if (ahead == 0 && writer.next > 0 && exists(file("a.h5.part"))) ahead = writer.next + 60;
    if (ahead != 0) back = ahead + 60;
    writer.clock_set_by_ns = ahead == 0 || writer.next < ahead ? 0 : writer.next < back ? kHour : -kHour;
    return exists(file("a.h5"));
  });
  ASSERT_EQ(program.outcome().exit_code, 0);
  const capture::CaptureReader reader = opened(file("a.h5"));
  ASSERT_TRUE(reader.info().has_times);
  std::vector<double> steps_s;
  for (const auto& event : reader.events()) {
    if (event.kind == "clock_step") steps_s.push_back(event.t_s);
  }
  ASSERT_EQ(steps_s.size(), 2U);
  EXPECT_NEAR(steps_s[0], static_cast<double>(ahead) * 0.005, 1e-9) << "the first frame of the new time";
  EXPECT_NEAR(steps_s[1], static_cast<double>(back) * 0.005, 1e-9);
  for (std::size_t i = 0; i < 300; ++i) {
    const std::uint64_t number = reader.frame_id()[i] / 2;
    const std::int64_t set_by = number < ahead ? 0 : number < back ? kHour : -kHour;
    ASSERT_NEAR(reader.t_host()[i], static_cast<double>(1000 + number) * 1e-9, 1e-12) << "it does not step";
    ASSERT_NEAR(reader.t_utc()[i], static_cast<double>(shm::utc_of(number) + set_by) * 1e-9, 1e-6);
  }
  const auto json_info = nlohmann::json::parse(run({"info", file("a.h5"), "--json"}).out);
  EXPECT_NEAR(json_info["attributes"]["utc_uncertainty_s"].get<double>(), 0.001500001, 1e-12);
  const std::string info = run({"info", file("a.h5")}).out;
  EXPECT_NE(info.find("  utc        2025-11-23T19:31:02.000Z to 2025-11-23T18:31:02.000Z, within 0.0015 s\n"),
            std::string::npos)
      << info;
}

TEST_F(RecordVerb, TheScenesMotionIsRecordedWithItsFrames) {
  shm::Writer writer(name_);
  writer.format.motion = true;
  ASSERT_TRUE(writer.open());
  Program program =
      start({"record", name_, "-o", file("a.h5"), "--frames", "300", "--split-minutes", "0.01", "--planes", "raw"});
  publish_until(writer, [&] { return exists(file("a_003.h5")); });
  ASSERT_EQ(program.outcome().exit_code, 0);
  for (const char* part : {"a_001.h5", "a_002.h5", "a_003.h5"}) {
    const capture::CaptureReader reader = opened(file(part));
    ASSERT_TRUE(reader.info().has_motion);
    expect_published(reader, 0);
    for (std::size_t i = 0; i < reader.info().frames; ++i) {
      const std::uint64_t number = reader.frame_id()[i] / 2;
      std::vector<BlockMotion> blocks(5);
      ASSERT_TRUE(reader.read_motion(i, blocks.data()));
      for (std::size_t b = 0; b < blocks.size(); ++b) {
        ASSERT_EQ(blocks[b].x, shm::moves(number) ? shm::motion_pattern(number, b, 0) : 0.0F) << number;
        ASSERT_EQ(blocks[b].confidence, shm::moves(number) ? shm::motion_pattern(number, b, 2) : 0.0F) << number;
      }
    }
  }
}

TEST_F(RecordVerb, DeblurredPlanesInFilesOfAGivenLength) {
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  // A hundredth of a minute are 120 frames of 5 ms.
  Program program = start(
      {"record", name_, "-o", file("a.h5"), "--frames", "300", "--planes", "deblurred", "--split-minutes", "0.01"});
  publish_until(writer, [&] { return exists(file("a_003.h5")); });
  ASSERT_EQ(program.outcome().exit_code, 0);
  for (const auto& [part, frames] : {std::pair{"a_001.h5", 120U}, {"a_002.h5", 120U}, {"a_003.h5", 60U}}) {
    expect_recorded(file(part), frames, 1);
  }
}

// Recordings of earlier drives, whole and cut off: their numbers are passed over, and no frame is lost for them.
TEST_F(RecordVerb, EarlierPartsStayAndCostNoFrame) {
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  std::ofstream(file("a_002.h5")) << "earlier";
  std::ofstream(file("a_003.h5.part")) << "unrecovered";
  Program program =
      start({"record", name_, "-o", file("a.h5"), "--frames", "300", "--split-minutes", "0.01", "--json"});
  publish_until(writer, [&] { return exists(file("a_005.h5")); });
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(test::contents(file("a_002.h5")), "earlier");
  EXPECT_EQ(test::contents(file("a_003.h5.part")), "unrecovered");
  EXPECT_NE(outcome.err.find("a_002.h5 is there already, and stays: going on with a_004.h5"), std::string::npos)
      << outcome.err;
  const json told = json::parse(outcome.out);
  EXPECT_EQ(told["frames"], 300);
  EXPECT_EQ(told["lost"]["unwritten"], 0);
  for (const auto& [part, frames] : {std::pair{"a_001.h5", 120U}, {"a_004.h5", 120U}, {"a_005.h5", 60U}}) {
    expect_recorded(file(part), frames);
  }
}

TEST_F(RecordVerb, WaitsForADaemonThatIsNotThereYet) {
  Program program = start({"record", name_, "-o", file("a.h5"), "--frames", "20", "--wait", "60"});
  ASSERT_TRUE(test::logged(program, "waiting for the daemon"));
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  publish_until(writer, [&] { return exists(file("a.h5")); });
  EXPECT_EQ(program.outcome().exit_code, 0);
}

// What is printed goes to a full disk: that is not done.
TEST_F(RecordVerb, OutputThatCannotBePrintedIsAFailure) {
  const std::string full =
      "'" + std::string(BOLO_PROGRAM) + "' simulate --list-effects >/dev/full 2>'" + file("err") + "'";
  EXPECT_EQ(WEXITSTATUS(std::system(full.c_str())), 1);
  EXPECT_NE(test::contents(file("err")).find("standard output cannot be written"), std::string::npos);
}

TEST_F(RecordVerb, InterruptEndsInGoodOrder) {
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {  // the last: the terminal is closed
    SCOPED_TRACE(signal);
    const std::string name = file(std::to_string(signal) + ".h5");
    Program program = start({"record", name_, "-o", name});
    std::uint64_t after_begin = 0;
    publish_until(writer, [&] { return exists(name + ".part") && ++after_begin > 50; });
    program.signal(signal);
    const Outcome outcome = program.outcome();
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_FALSE(exists(name + ".part"));
    expect_published(opened(name), 0);
  }
}

TEST_F(RecordVerb, FollowsADaemonThatIsStartedAgain) {
  auto writer = std::make_unique<shm::Writer>(name_);
  ASSERT_TRUE(writer->open());
  Program program = start({"record", name_, "-o", file("a.h5"), "--frames", "200", "--json"});
  std::uint64_t after_begin = 0;
  publish_until(*writer, [&] { return exists(file("a.h5") + ".part") && ++after_begin > 60; });
  writer->sink.close();
  writer = std::make_unique<shm::Writer>(name_);  // numbers and times begin anew
  ASSERT_TRUE(writer->open());
  publish_until(*writer, [&] { return exists(file("a.h5")); });
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(json::parse(outcome.out)["reconnects"], 1);
  const capture::CaptureReader reader = opened(file("a.h5"));  // refuses numbers and times that don't rise
  EXPECT_EQ(reader.info().frames, 200U);
  ASSERT_EQ(reader.events().size(), 1U);
  EXPECT_EQ(reader.events()[0].kind, "reconnect");
}

// A killed daemon's heartbeat looks alive for two seconds. Its successor's ring is shorter than that here, so that
// frames would be overwritten if the recorder waited for it to grow old.
TEST_F(RecordVerb, FollowsAKilledDaemonBeforeItsSuccessorsRingComesRound) {
  constexpr int kSlots = 256;  // 1.3 s
  const pid_t killed = fork();
  if (killed == 0) {
    auto* writer = new shm::Writer(name_, {33, 7}, kSlots);
    if (!writer->open()) _exit(1);
    for (;;) {
      writer->publish();
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
  const auto begin = std::chrono::steady_clock::now();
  const auto waits = [&] { return std::chrono::steady_clock::now() - begin < kHangGuard; };
  while (!shm::ShmReader::open(name_) && waits()) std::this_thread::yield();
  Program program = start({"record", name_, "-o", file("a.h5"), "--json"});
  while (!exists(file("a.h5") + ".part") && waits()) std::this_thread::yield();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  kill(killed, SIGKILL);
  ASSERT_EQ(waitpid(killed, nullptr, 0), killed);
  shm::Writer successor(name_, {33, 7}, kSlots);
  ASSERT_TRUE(successor.open());
  for (int i = 0; i < 3 * kSlots; ++i) {
    successor.publish();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  program.signal(SIGINT);
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json told = json::parse(outcome.out);
  EXPECT_EQ(told["reconnects"], 1);
  EXPECT_EQ(told["lost"]["overwritten"], 0);
  EXPECT_GT(told["frames"], 2 * kSlots);
}

// A ring that is turned over faster than it is read: what was overwritten is counted, and marked in the file.
TEST_F(RecordVerb, OverwrittenFramesAreCounted) {
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  Program program = start({"record", name_, "-o", file("a.h5"), "--frames", "400", "--json"});
  std::uint64_t after_begin = 0;
  publish_until(writer, [&] { return exists(file("a.h5") + ".part") && ++after_begin > 100; });
  program.signal(SIGSTOP);
  for (int i = 0; i < 3000; ++i) writer.publish();
  program.signal(SIGCONT);
  publish_until(writer, [&] { return exists(file("a.h5")); });
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json told = json::parse(outcome.out);
  EXPECT_GT(told["lost"]["overwritten"], 1000);
  const capture::CaptureReader reader = opened(file("a.h5"));
  expect_published(reader, 0);
  ASSERT_FALSE(reader.events().empty());
  EXPECT_EQ(reader.events()[0].kind, "gap");
}

// The limit on file size stands for the end of the disk. The program inherits it from this process.
TEST_F(RecordVerb, FullDiskEndsInAGoodCapture) {
  shm::Writer writer(name_, {320, 240});
  ASSERT_TRUE(writer.open());
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit limit{rlim_t{12} << 20, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  Program program = start({"record", name_, "-o", file("a.h5"), "--frames", "2000", "--json"});
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  publish_until(writer, [&] { return exists(file("a.h5")); });
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_NE(outcome.err.find("no room to write"), std::string::npos) << outcome.err;
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  const capture::CaptureReader reader = opened(file("a.h5"));
  EXPECT_GT(reader.info().frames, 20U);
  EXPECT_EQ(json::parse(outcome.out)["frames"], reader.info().frames);
  expect_published(reader, 0);
}

TEST_F(RecordVerb, AKilledRecordingIsRecovered) {
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  Program program = start({"record", name_, "-o", file("a.h5")});
  std::uint64_t after_begin = 0;
  publish_until(writer, [&] { return exists(file("a.h5") + ".part") && ++after_begin > 600; });
  program.signal(SIGKILL);
  EXPECT_EQ(program.outcome().exit_code, 128 + SIGKILL);
  std::size_t frames = 0;
  {
    const auto part = capture::CaptureReader::open(file("a.h5") + ".part");
    ASSERT_TRUE(part) << part.error().message;
    EXPECT_TRUE(part->warnings().empty());
    expect_published(*part, 0);
    frames = part->info().frames;
    const Outcome early = run({"recover", file("a.h5") + ".part", "--in-place"});
    EXPECT_EQ(early.exit_code, 1);
    EXPECT_NE(early.err.find("another program has it open"), std::string::npos) << early.err;
  }

  const Outcome again = run({"record", name_, "-o", file("a.h5")});
  EXPECT_EQ(again.exit_code, 2) << "an unfinished recording is not written over";
  EXPECT_NE(again.err.find("bolo recover"), std::string::npos) << again.err;

  const Outcome copied = run({"recover", file("a.h5") + ".part", "-o", file("b.h5"), "--json"});
  ASSERT_EQ(copied.exit_code, 0) << copied.err;
  EXPECT_EQ(json::parse(copied.out)["frames"], frames);
  EXPECT_TRUE(exists(file("a.h5") + ".part"));
  const Outcome finished = run({"recover", file("a.h5") + ".part", "--in-place"});
  ASSERT_EQ(finished.exit_code, 0) << finished.err;
  EXPECT_FALSE(exists(file("a.h5") + ".part"));
  for (const std::string& saved : {file("a.h5"), file("b.h5")}) {
    expect_recorded(saved, frames);
  }
}

TEST_F(RecordVerb, WrongUsageIsOneLine) {
  refused({"record", "-o", file("a.h5")}, "which daemon");
  refused({"record", name_}, "where to");
  refused({"record", name_, "-o", file("a.h5")}, "no shared memory named");
  refused({"record", name_, "-o", file("a.avi")}, "ends in .h5");
  refused({"record", name_, "-o", file("a.h5"), "--frames", "nan"}, "--frames: ");
  refused({"record", name_, "-o", file("a.h5"), "--frames=nan"}, "--frames: ");
  refused({"info", file("two\nlines.h5")}, "two?lines.h5");
  refused({"record", name_, "-o", file("a.h5"), "--frames", "0"}, "--frames");
  refused({"record", name_, "-o", file("a.h5"), "--seconds", "-1"}, "--seconds");
  refused({"record", name_, "-o", file("a.h5"), "--planes", "both"}, "--planes");
  shm::Writer writer(name_);
  ASSERT_TRUE(writer.open());
  refused({"record", name_, "-o", file("no/such/folder.h5")}, "No such file");
  refused({"record", name_, "-o", "/dev/full"}, "ends in .h5");
  refused({"recover", file("absent.h5.part")}, "No such file");
  refused({"recover", file("absent.h5")}, "where to");
}

// A capture that was cut off: frames up to the cut are saved, the file stays as it is.
TEST_F(RecordVerb, ACutOffCaptureIsRecovered) {
  capture::CaptureInfo info;
  info.format.geometry = {64, 48};
  info.format.frame_period_s = 0.005;
  auto writer = capture::CaptureWriter::create(file("a.h5"), info);
  ASSERT_TRUE(writer);
  std::vector<std::uint16_t> plane(64 * 48);
  for (std::uint64_t i = 0; i < 400; ++i) {
    shm::fill(plane, i, 0);
    ASSERT_TRUE(writer->append(static_cast<double>(i) * 0.005, 2 * i, plane.data()));
  }
  ASSERT_TRUE(writer->close());
  const auto size = fs::file_size(file("a.h5"));
  fs::resize_file(file("a.h5"), size * 6 / 10);
  EXPECT_EQ(run({"info", file("a.h5")}).exit_code, 2);
  const Outcome outcome = run({"recover", file("a.h5"), "-o", file("b.h5"), "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json told = json::parse(outcome.out);
  EXPECT_GT(told["frames"], 150);
  EXPECT_FALSE(told["missing"].empty());
  EXPECT_EQ(fs::file_size(file("a.h5")), size * 6 / 10);
  expect_published(opened(file("b.h5")), 0);
}

}  // namespace
}  // namespace bolo::tools
