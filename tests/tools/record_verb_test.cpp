// `bolo record` and `bolo recover` as their users meet them; the daemon is a writer of shared memory fed by the test.
#include <sys/resource.h>

#include <regex>

#include <nlohmann/json.hpp>

#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"

namespace bolo::tools::test::record_verb_test {

namespace fs = std::filesystem;
using nlohmann::json;

bool exists(const std::string& file) { return fs::exists(file); }

capture::CaptureReader opened(const std::string& file) { return *must(capture::CaptureReader::open(file)); }

// Every frame is as it was published.
void expect_published(const capture::CaptureReader& reader, std::size_t plane_index = 0) {
  for (std::size_t i = 0; i < reader.info().frames; ++i) {
    const std::uint64_t number = reader.frame_id()[i] / 2;
    const auto plane = frame_values(reader, i);
    for (std::size_t p = 0; p < plane.size(); ++p) ASSERT_EQ(plane[p], shm::pattern(number, plane_index, p));
    ASSERT_NEAR(reader.t()[i], static_cast<double>(number) * 0.005, 1e-9);
  }
}

// A capture of this many frames, as they were published.
void expect_recorded(const std::string& file, std::size_t frames, std::size_t plane_index = 0) {
  const capture::CaptureReader reader = opened(file);
  EXPECT_EQ(reader.info().frames, frames) << file;
  expect_published(reader, plane_index);
}

class RecordVerb : public ProgramTest {
 protected:
  RecordVerb() : ProgramTest({BOLO_PROGRAM}) {}

  // Records this test's writer into a.h5.
  Program recording(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words{"record", name_, "-o", file("a.h5"), "--json"};
    words.insert(words.end(), more.begin(), more.end());
    return start(words);
  }
  // Opens the writer first.
  Program record(const std::vector<std::string>& more = {}) {
    must(writer_.open());
    return recording(more);
  }
  // Publishes until the recording has begun, and `frames` more.
  void publish_into_it(int frames) {
    writer_.publish_until([&] { return exists(file("a.h5.part")) && --frames < 0; });
  }
  // Publishes until `last` is whole; returns the recording's final report.
  json end_of(Program& program, const std::string& last = "a.h5") {
    writer_.publish_until([&] { return exists(file(last)); });
    const Outcome outcome = program.outcome();
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return json::parse(outcome.out);
  }

  const std::string name_ = shm::unique_name(testing::UnitTest::GetInstance()->current_test_info()->name());
  shm::Writer writer_{name_};  // not open yet
};

TEST_F(RecordVerb, SeveralCamerasGoIntoOneFolder) {
  shm::Writer left(name_ + "-l");
  shm::Writer right(name_ + "-r");
  ASSERT_TRUE(left.open() && right.open());
  Program program = start({"record", name_ + "-l", name_ + "-r", "-o", file("rig"), "--frames", "100", "--json"});
  const std::string files[] = {file("rig/" + name_ + "-l.h5"), file("rig/" + name_ + "-r.h5")};
  left.publish_until([&] {
    right.publish();
    return exists(files[0]) && exists(files[1]);
  });
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  expect_parts(outcome.out, {files[0], files[1]});
  for (const std::string& one : files) expect_recorded(one, 100);
  refused({"record", name_ + "-l", name_ + "-l", "-o", file("rig")}, "is named twice");
  refused({"record", name_ + "-l", name_ + "-r", "-o", file("rig.h5")}, "into a folder");
}

// A missing daemon costs the other recording nothing, and is reported.
TEST_F(RecordVerb, AnInterruptEndsAllInGoodOrder) {
  ASSERT_TRUE(writer_.open());
  Program program = start({"record", name_, name_ + "-none", "-o", file("rig")});
  const std::string recorded = file("rig/" + name_ + ".h5");
  int frames = 0;
  writer_.publish_until(
      [&] { return exists(recorded + ".part") && program.err().find("-none") != std::string::npos && ++frames > 100; });
  program.signal(SIGINT);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
  EXPECT_TRUE(exists(recorded)) << outcome.err;
}

TEST_F(RecordVerb, StatShowsAllThatRun) {
  shm::Writer other(name_ + "-r");
  ASSERT_TRUE(writer_.open() && other.open());
  std::map<std::string, std::string> state;
  std::istringstream lines(printed({"stat", "--once", "--json", "--interval", "0.1"}));
  for (std::string line; std::getline(lines, line);) {
    const json row = json::parse(line);
    state[row["name"]] = row["state"];
  }
  EXPECT_TRUE(state.contains(name_) && state.contains(name_ + "-r")) << state.size();
  const std::string table = printed({"stat", "--once", "--interval", "0.1"});
  EXPECT_TRUE(table.starts_with("camera ")) << table;
  EXPECT_GE(std::ranges::count(table, '\n'), 3) << table;
}

TEST_F(RecordVerb, FramesAreThePublishedOnes) {
  Program program = record({"--frames", "300"});
  const json report = end_of(program);
  EXPECT_EQ(report["frames"], 300);
  EXPECT_EQ(report["lost"]["overwritten"], 0);
  EXPECT_EQ(report["lost"]["no_room"], 0);
  const capture::CaptureReader reader = opened(file("a.h5"));
  ASSERT_EQ(reader.info().frames, 300U);
  EXPECT_EQ(reader.info().camera_model, "Model");
  EXPECT_EQ(reader.info().camera_serial, "1234");
  EXPECT_EQ(reader.info().format.scale.offset, 5.0);
  expect_published(reader);
  EXPECT_FALSE(reader.info().has_motion);
  const std::string info = printed({"info", file("a.h5")});
  const std::regex recorded("recorded   20[0-9-]{8}T[0-9:]{8}\\.[0-9]{3}Z on [^ ]+ by bolo [0-9]+\\.[0-9.]+\n");
  EXPECT_TRUE(std::regex_search(info, recorded)) << info;
  expect_parts(info, {" uint16, 1.495 s, "});
  for (const char* left : {".part", ".part.journal", ".part.live"}) EXPECT_FALSE(exists(file("a.h5") + left)) << left;
}

// The period is found once frames arrive, from a camera whose settings state another rate than its clock.
TEST_F(RecordVerb, AnotherPeriodThatTheDaemonFindsIsInTheFile) {
  writer_.stats.period_s.set(0.005);
  Program program = record({"--frames", "100"});
  publish_into_it(20);
  writer_.stats.period_s.set(0.0055);
  end_of(program);
  EXPECT_EQ(opened(file("a.h5")).info().format.frame_period_s, 0.0055);
}

// Meanwhile the clock is set by an hour, and later back by more.
TEST_F(RecordVerb, UtcIsRecordedAndAStepOfTheClockIsSaid) {
  constexpr std::int64_t kHour = 3'600'000'000'000;
  Program program = record({"--frames", "300"});
  std::uint64_t ahead = 0;
  std::uint64_t back = 0;
  writer_.publish_until([&] {
    if (ahead == 0 && writer_.next > 0 && exists(file("a.h5.part"))) ahead = writer_.next + 60;
    if (ahead != 0) back = ahead + 60;
    writer_.clock_set_by_ns = ahead == 0 || writer_.next < ahead ? 0 : writer_.next < back ? kHour : -kHour;
    return exists(file("a.h5"));
  });
  ASSERT_EQ(program.wait(), 0);
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
  const json info = json::parse(printed({"info", file("a.h5"), "--json"}));
  EXPECT_NEAR(info["attributes"]["utc_uncertainty_s"].get<double>(), 0.001500001, 1e-12);
  expect_parts(printed({"info", file("a.h5")}),
               {"  utc        2025-11-23T19:31:02.000Z to 2025-11-23T18:31:02.000Z, within 0.0015 s\n"});
}

// A hundredth of a minute are 120 frames of 5 ms.
TEST_F(RecordVerb, TheScenesMotionIsRecordedWithItsFrames) {
  writer_.format.motion = true;
  Program program = record({"--frames", "300", "--split-minutes", "0.01", "--planes", "raw"});
  (void)end_of(program, "a_003.h5");
  for (const char* part : {"a_001.h5", "a_002.h5", "a_003.h5"}) {
    const capture::CaptureReader reader = opened(file(part));
    ASSERT_TRUE(reader.info().has_motion);
    expect_published(reader);
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

// Recordings of earlier drives, whole and cut off, and links of others: their numbers are skipped, no frame is lost.
TEST_F(RecordVerb, EarlierPartsStayAndCostNoFrame) {
  write("a_002.h5", "earlier");
  write("a_003.h5.part", "unrecovered");
  std::filesystem::create_symlink("a_002.h5", file("a_004.h5.part.journal"));
  Program program = record({"--frames", "300", "--planes", "deblurred", "--split-minutes", "0.01"});
  const json report = end_of(program, "a_006.h5");
  EXPECT_EQ(contents(file("a_002.h5")), "earlier");
  EXPECT_EQ(contents(file("a_003.h5.part")), "unrecovered");
  EXPECT_EQ(report["frames"], 300);
  EXPECT_EQ(report["lost"]["unwritten"], 0);
  for (const auto& [part, frames] : {std::pair{"a_001.h5", 120U}, {"a_005.h5", 120U}, {"a_006.h5", 60U}}) {
    expect_recorded(file(part), frames, 1);
  }
  expect_parts(program.err(), {"a_002.h5 is there already, and stays: going on with a_005.h5"});
}

TEST_F(RecordVerb, WaitsForADaemonThatIsNotThereYet) {
  Program program = start({"record", name_, "-o", file("a.h5"), "--frames", "20", "--wait", "60"});
  ASSERT_TRUE(logged(program, "waiting for the daemon"));
  ASSERT_TRUE(writer_.open());
  writer_.publish_until([&] { return exists(file("a.h5")); });
  EXPECT_EQ(program.wait(), 0);
}

// A daemon whose camera sends nothing: a recording with a time limit still ends.
TEST_F(RecordVerb, SecondsWithoutAFrameEnd) {
  Program program = record({"--seconds", "0.3", "--wait", "0.2"});
  EXPECT_TRUE(eventually([&] {
    writer_.sink.idle(writer_.stats);  // its signs of life
    return program.err().find("runs, but no frame came from it; no file was finished") != std::string::npos;
  }));
  EXPECT_EQ(program.wait(), 1);
}

TEST_F(RecordVerb, OutputThatCannotBePrintedIsAFailure) {
  ASSERT_TRUE(writer_.open());
  for (const std::string& verb : {std::string("simulate --list-effects"), "stat --interval 0.1 " + name_}) {
    Program full({"/bin/sh", "-c", "exec \"$0\" " + verb + " > /dev/full", BOLO_PROGRAM}, file("full"));
    EXPECT_EQ(full.wait(), 1);
    expect_parts(full.err(), {"standard output cannot be written"});
  }
}

TEST_F(RecordVerb, InterruptEndsInGoodOrder) {
  ASSERT_TRUE(writer_.open());
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {  // the last: the terminal is closed
    SCOPED_TRACE(signal);
    Program program = recording();
    publish_into_it(50);
    program.signal(SIGPIPE);  // who read its words has ended: the recording has not
    program.signal(signal);
    ASSERT_EQ(program.wait(), 0) << program.err();
    EXPECT_FALSE(exists(file("a.h5.part")));
    expect_published(opened(file("a.h5")));
    fs::remove(file("a.h5"));
  }
}

TEST_F(RecordVerb, FollowsADaemonThatIsStartedAgain) {
  Program program = record({"--frames", "200"});
  publish_into_it(60);
  writer_.sink.close();
  shm::Writer next(name_);  // numbers and times begin anew
  ASSERT_TRUE(next.open());
  next.publish_until([&] { return exists(file("a.h5")); });
  EXPECT_EQ(end_of(program)["reconnects"], 1);
  const capture::CaptureReader reader = opened(file("a.h5"));  // refuses numbers and times that don't rise
  EXPECT_EQ(reader.info().frames, 200U);
  ASSERT_EQ(reader.events().size(), 1U);
  EXPECT_EQ(reader.events()[0].kind, "reconnect");
}

// The camera begins its count anew, two seconds later: `bolo info` tells these frames from the file.
TEST_F(RecordVerb, FramesThatABreakOfTheCameraTookAreLost) {
  Program program = record({"--frames", "200"});
  publish_into_it(60);
  writer_.next = 0;
  writer_.received_from_ns += 2'000'000'000;
  writer_.publish_until([&] { return exists(file("a.h5")); });
  EXPECT_EQ(end_of(program)["lost"]["before"], 198 + 399) << "every second number is one, too";
}

// A killed daemon's heartbeat looks alive for two seconds. Here its successor's ring is shorter than that, so frames
// would be overwritten if the recorder waited for the heartbeat to expire.
TEST_F(RecordVerb, FollowsAKilledDaemonBeforeItsSuccessorsRingComesRound) {
  constexpr int kSlots = 256;  // 1.3 s
  const auto publish_at_its_rate = [](shm::Writer& writer, int frames) {
    for (; frames > 0; --frames) {
      writer.publish();
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  };
  const pid_t killed = fork();
  if (killed == 0) {
    auto* writer = new shm::Writer(name_, {33, 7}, kSlots);
    if (writer->open()) publish_at_its_rate(*writer, 60 * 200);
    _exit(1);
  }
  EXPECT_TRUE(eventually([&] { return shm::ShmReader::open(name_).has_value(); }));
  Program program = recording();
  EXPECT_TRUE(eventually([&] { return exists(file("a.h5.part")); }));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  kill(killed, SIGKILL);
  ASSERT_EQ(waitpid(killed, nullptr, 0), killed);
  shm::Writer successor(name_, {33, 7}, kSlots);
  ASSERT_TRUE(successor.open());
  publish_at_its_rate(successor, 3 * kSlots);
  program.signal(SIGINT);
  const Outcome outcome = program.outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json report = json::parse(outcome.out);
  EXPECT_EQ(report["reconnects"], 1);
  EXPECT_EQ(report["lost"]["overwritten"], 0);
  EXPECT_GT(report["frames"], 2 * kSlots);
}

// A ring that is overwritten faster than it is read: losses are counted and marked in the file.
TEST_F(RecordVerb, OverwrittenFramesAreCounted) {
  Program program = record({"--frames", "400"});
  publish_into_it(100);
  ASSERT_TRUE(program.stop());
  for (int i = 0; i < 3000; ++i) writer_.publish();
  program.signal(SIGCONT);
  EXPECT_GT(end_of(program)["lost"]["overwritten"], 1000);
  const capture::CaptureReader reader = opened(file("a.h5"));
  expect_published(reader);
  ASSERT_FALSE(reader.events().empty());
  EXPECT_EQ(reader.events()[0].kind, "gap");
}

// The limit on file size simulates a full disk. The program inherits it from this process.
TEST_F(RecordVerb, FullDiskEndsInAGoodCapture) {
  writer_.format.source.format.geometry = {320, 240};
  ASSERT_TRUE(writer_.open());
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit limit{rlim_t{12} << 20, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  Program program = recording({"--frames", "2000"});
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  writer_.publish_until([&] { return exists(file("a.h5")); });
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 1);
  expect_parts(outcome.err, {"no room to write"});
  EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
  const capture::CaptureReader reader = opened(file("a.h5"));
  EXPECT_GT(reader.info().frames, 20U);
  EXPECT_EQ(json::parse(outcome.out)["frames"], reader.info().frames);
  expect_published(reader);
}

TEST_F(RecordVerb, AFolderThatIsMovedAwayEndsItAndIsSaid) {
  ASSERT_TRUE(writer_.open());
  fs::create_directory(file("drive"));
  Program program = start({"record", name_, "-o", file("drive/a.h5"), "--frames", "4000"});
  int frames = 50;
  writer_.publish_until([&] { return exists(file("drive/a.h5.part")) && --frames < 0; });
  fs::rename(file("drive"), file("kept"));
  writer_.publish_until([&] { return !program.err().empty(); });
  EXPECT_EQ(program.wait(), 1);
  expect_parts(program.err(), {"was removed, renamed or cut off", "no longer there: if it was moved, bolo recover"});
}

TEST_F(RecordVerb, AKilledRecordingIsRecovered) {
  const std::string part = file("a.h5.part");
  Program program = record();
  publish_into_it(600);
  program.signal(SIGKILL);
  EXPECT_EQ(program.wait(), 128 + SIGKILL);
  std::size_t frames = 0;
  {
    const capture::CaptureReader reader = opened(part);
    EXPECT_TRUE(reader.warnings().empty());
    expect_published(reader);
    frames = reader.info().frames;
    const Outcome early = run({"recover", part, "--in-place"});
    EXPECT_EQ(early.exit_code, 1);
    expect_parts(early.err, {"another program has it open"});
  }
  refused({"record", name_, "-o", file("a.h5")}, "bolo recover");  // an unfinished recording is not written over
  std::ofstream(file("c.h5.part"));
  refused({"record", name_, "-o", file("c.h5")}, "c.h5.part: is there, and empty; remove it");  // nothing to recover
  EXPECT_EQ(json::parse(printed({"recover", part, "-o", file("b.h5"), "--json"}))["frames"], frames);
  std::filesystem::copy(part, file("moved.h5.part"));  // and what was not on the disk yet stayed behind
  std::filesystem::resize_file(file("moved.h5.part"), 100);
  refused({"recover", file("moved.h5.part")}, "moved.h5.part.journal is not there: if the recording was moved");
  EXPECT_TRUE(exists(part));
  done({"recover", part, "--in-place"});
  EXPECT_FALSE(exists(part));
  for (const char* saved : {"a.h5", "b.h5"}) expect_recorded(file(saved), frames);
}

TEST_F(RecordVerb, WrongUsageIsOneLine) {
  refused({"record", "-o", file("a.h5")}, "which daemon");
  refused({"record", name_}, "where to");
  refused({"record", name_, "-o", file("a.h5")}, "no shared memory named");
  refused({"record", name_ + "," + name_, "-o", file("a.h5")}, "is no name for shared memory");
  refused({"record", name_, "-o", file("a.avi")}, "ends in .h5");
  refused({"record", name_, "-o", file("a.h5"), "--frames", "nan"}, "--frames: ");
  refused({"record", name_, "-o", file("a.h5"), "--frames=nan"}, "--frames: ");
  refused({"info", file("two\nlines.h5")}, "two?lines.h5");
  refused({"record", name_, "-o", file("a.h5"), "--frames", "0"}, "--frames");
  refused({"record", name_, "-o", file("a.h5"), "--seconds", "-1"}, "--seconds");
  refused({"record", name_, "-o", file("a.h5"), "--planes", "both"}, "--planes");
  ASSERT_TRUE(writer_.open());
  refused({"record", name_, "-o", file("no/such/folder.h5")}, "No such file");
  refused({"record", name_, "-o", "/dev/full"}, "ends in .h5");
  refused({"view", name_, "--port", "99999"}, "--port 99999: expected 0 to 65535");
  refused({"view", name_, "--page", file("none")}, "there is no such folder");
  refused({"recover", file("absent.h5.part")}, "No such file");
  refused({"recover", file("absent.h5")}, "where to");
}

// A capture that was cut off: frames up to the cut are saved, the file stays as it is.
TEST_F(RecordVerb, ACutOffCaptureIsRecovered) {
  SmallCapture capture(file("a.h5"), small_info({64, 48}));
  for (std::uint64_t i = 0; i < 400; ++i) {
    capture.append(static_cast<double>(i) * 0.005, 2 * i, [i](std::size_t p) { return shm::pattern(i, 0, p); });
  }
  capture.close();
  const auto left = fs::file_size(file("a.h5")) * 6 / 10;
  fs::resize_file(file("a.h5"), left);
  EXPECT_EQ(run({"info", file("a.h5")}).exit_code, 2);
  const json report = json::parse(printed({"recover", file("a.h5"), "-o", file("b.h5"), "--json"}));
  EXPECT_GT(report["frames"], 150);
  EXPECT_FALSE(report["missing"].empty());
  EXPECT_EQ(fs::file_size(file("a.h5")), left);
  expect_published(opened(file("b.h5")));
}

}  // namespace bolo::tools::test::record_verb_test
