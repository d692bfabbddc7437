// The whole way: a capture, bolod, shared memory, a reader; signals, names, `bolo stat`.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "drivers/shm/shm_reader.hpp"
#include "src/core/frame.hpp"
#include "src/core/loss.hpp"
#include "tests/tools/bolod/bolod_run.hpp"

namespace bolo::daemon::bolod_run_test {
namespace {

TEST_F(BolodRun, FramesOfACaptureReachAReader) {
  const auto daemon = start(300);
  auto reader = attach();
  ASSERT_TRUE(reader) << reader.error().message << daemon->err();
  EXPECT_EQ(reader->header().width, 64U);
  EXPECT_EQ(reader->header().height, 24U);
  EXPECT_STREQ(reader->header().camera_model, "Test camera");

  ReadFrame frame;
  std::uint64_t seen = 0;
  std::uint64_t sharp = 0;
  std::uint64_t with_gap = 0;
  std::uint64_t number = 0;
  for (Outcome outcome = Outcome::kFrame; outcome != Outcome::kClosed; ++number) {
    outcome = reader->read(number, frame, 60'000);
    ASSERT_NE(outcome, Outcome::kTimeout);
    if (outcome != Outcome::kFrame) continue;
    ++seen;
    EXPECT_EQ(frame.raw[0], static_cast<std::uint16_t>(frame.meta.frame_id));
    EXPECT_EQ(frame.meta.camera_ns, static_cast<std::int64_t>(frame.meta.frame_id) * 5'000'000);
    EXPECT_GE(frame.publish_ns, frame.meta.receive_ns);
    std::size_t wrong = 0;
    const bool warm_up = (frame.meta.flags & kFlagWarmUp) != 0;
    for (std::size_t i = 1; i < frame.raw.size(); ++i) {
      if (frame.raw[i] != scene(i) || std::abs(int{frame.deblurred[i]} - int{scene(i)}) > (warm_up ? 0 : 1)) ++wrong;
    }
    EXPECT_EQ(wrong, 0U) << "frame " << frame.meta.frame_id;
    if (!warm_up) ++sharp;
    if ((frame.meta.flags & kFlagGap) != 0) ++with_gap;
  }
  EXPECT_GT(seen, 0U);
  EXPECT_GT(sharp, 0U);
  EXPECT_EQ(daemon->wait(), 0) << daemon->err();
  const std::string log = daemon->err();
  EXPECT_NE(log.find("in.h5 Test camera 42, 64x24 at 200 Hz"), std::string::npos) << log;
  EXPECT_NE(log.find("frames arrive"), std::string::npos) << log;
  EXPECT_NE(log.find("ended: "), std::string::npos) << log;
  EXPECT_NE(log.find("1 missing"), std::string::npos) << log;
  const bolo_shm_header header = reader->header();
  EXPECT_EQ(header.lost[static_cast<std::size_t>(LossCause::kMissing)], 1U);
  EXPECT_LE(with_gap, header.gap_frames);
  EXPECT_GT(header.gap_frames, 0U);
}

TEST_F(BolodRun, SigtermEndsItInGoodOrder) {
  const auto daemon = start(100'000 / 5);  // 100 s: it can only end by the signal
  auto reader = attach();
  ASSERT_TRUE(reader) << daemon->err();
  ReadFrame frame;
  ASSERT_NE(reader->read(5, frame, 60'000), Outcome::kTimeout);
  daemon->signal(SIGHUP);
  ASSERT_TRUE(logged(*daemon, "reload: nothing to take up"));
  const std::uint64_t before = reader->published();
  EXPECT_NE(reader->read(before + 5, frame, 60'000), Outcome::kClosed) << "SIGHUP does not end it";
  expect_good_end(*daemon);
  EXPECT_TRUE(reader->closed());
  EXPECT_EQ(reader->header().state, std::uint32_t{BOLO_SHM_CLOSED});
  EXPECT_FALSE(ShmReader::open(name_)) << "the name is free again";
  EXPECT_NE(daemon->err().find("SIGTERM: stopping"), std::string::npos) << daemon->err();
}

TEST_F(BolodRun, ASecondDaemonOfTheSameNameIsRefused) {
  const auto first = start(20'000);
  auto reader = attach();
  ASSERT_TRUE(reader) << first->err();
  const auto second = start_again("", "second");
  EXPECT_EQ(second->wait(), 2);
  EXPECT_NE(second->err().find("is written by process"), std::string::npos) << second->err();
  ReadFrame frame;
  EXPECT_NE(reader->read(reader->published() + 5, frame, 60'000), Outcome::kClosed) << "the first one goes on";
  first->signal(SIGINT);
  EXPECT_EQ(first->wait(), 0) << first->err();
}

TEST_F(BolodRun, AKilledDaemonIsFollowedByAnother) {
  const auto first = start(20'000);
  ASSERT_TRUE(attach());
  first->signal(SIGKILL);
  EXPECT_EQ(first->wait(), 128 + SIGKILL);
  const auto second = start_again("", "second");
  ReadFrame frame;
  ASSERT_TRUE(eventually([&] {
    auto reader = ShmReader::open(name_);
    return reader && reader->header().writer_pid == second->pid() && reader->read(0, frame, 100) == Outcome::kFrame;
  })) << second->err();
  expect_good_end(*second);
}

// Shared memory is a file, too: beyond the limit on files is a full /dev/shm, not the end by a signal.
TEST_F(BolodRun, ALimitOnFilesIsAFullDisk) {
  write_capture(folder_ / "in.h5", 100);
  Program limited({"/bin/sh", "-c", "ulimit -f 8; exec \"$0\" --config \"$1\"", BOLOD_PROGRAM, configure(kReplay)},
                  file("limited"));
  EXPECT_EQ(limited.wait(), 2);
  EXPECT_NE(limited.err().find("/dev/shm has no room"), std::string::npos) << limited.err();
  EXPECT_FALSE(std::filesystem::exists("/dev/shm/bolo." + name_));
}

// Cleaners of temporary files take sockets away.
TEST_F(BolodRun, AControlSocketThatWasTakenAwayIsMadeAgain) {
  const std::string socket = file("control");
  const auto daemon = start(20'000, "[control]\nsocket = '" + socket + "'\n");
  ASSERT_TRUE(attach()) << daemon->err();
  const auto asked = [&] {
    Program nuc({BOLO_PROGRAM, "nuc", name_}, file("nuc"));
    nuc.wait();
    return nuc.err();
  };
  EXPECT_NE(asked().find("no camera"), std::string::npos) << asked();
  ASSERT_TRUE(std::filesystem::remove(socket));
  EXPECT_TRUE(eventually([&] { return std::filesystem::exists(socket); })) << daemon->err();
  EXPECT_TRUE(logged(*daemon, "was taken away; it is there again"));
  EXPECT_NE(asked().find("no camera"), std::string::npos) << asked();
  // What somebody else put there is his.
  ASSERT_TRUE(std::filesystem::remove(socket));
  std::ofstream(socket) << "mine";
  EXPECT_TRUE(logged(*daemon, "it is tried again all the time"));
  expect_good_end(*daemon);
  EXPECT_EQ(tools::test::contents(socket), "mine");
}

// Its socket takes no more connections then, and to connect waits.
TEST_F(BolodRun, AStoppedDaemonIsNotWaitedForByOthers) {
  const std::string control = "[control]\nsocket = '" + file("control") + "'\n";
  const auto daemon = start(20'000, control);
  ASSERT_TRUE(attach()) << daemon->err();
  daemon->signal(SIGSTOP);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  file("control").copy(address.sun_path, sizeof address.sun_path - 1);
  std::vector<UniqueFd> waiting;
  for (int i = 0; i < 100; ++i) {
    waiting.emplace_back(socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    if (connect(waiting.back().get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) break;
  }
  ASSERT_LT(waiting.size(), 100U);
  Program nuc({BOLO_PROGRAM, "nuc", name_}, file("nuc"));
  const std::string own = name_;
  name_ += "-second";
  const auto second = start_again(control, "second");
  name_ = own;
  EXPECT_EQ(second->wait(), 2);
  EXPECT_NE(second->err().find("another daemon listens there"), std::string::npos) << second->err();
  EXPECT_EQ(nuc.wait(), 1);
  EXPECT_NE(nuc.err().find("the daemon did not answer"), std::string::npos) << nuc.err();
  daemon->signal(SIGCONT);
}

TEST_F(BolodRun, SignalsThatMeanNothingDoNotEndIt) {
  const auto daemon = start(20'000);
  ASSERT_TRUE(attach()) << daemon->err();
  for (const int signal : {SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO, SIGPIPE, SIGXFSZ, SIGPWR, SIGRTMIN}) {
    daemon->signal(signal);
  }
  daemon->signal(SIGHUP);
  ASSERT_TRUE(logged(*daemon, "reload: nothing to take up"));
  expect_good_end(*daemon);
}

// A recording's file would be given what is printed.
TEST_F(BolodRun, NothingTakesThePlaceOfAClosedStream) {
  write_capture(folder_ / "in.h5", 20'000);
  const auto start_closed = [&](const std::vector<std::string>& words) {
    std::vector<std::string> shell{"/bin/sh", "-c", "exec \"$@\" <&- >&- 2>&-", "sh"};
    shell.insert(shell.end(), words.begin(), words.end());
    return std::make_unique<Program>(shell, file("closed"));
  };
  const auto held = [](const Program& program) {
    for (const char* stream : {"0", "1", "2"}) {
      std::error_code error;
      const auto place = "/proc/" + std::to_string(program.pid()) + "/fd/" + stream;
      if (std::filesystem::read_symlink(place, error) != "/dev/null") return false;
    }
    return true;
  };
  const auto daemon = start_closed({BOLOD_PROGRAM, "--config", configure(kReplay)});
  ASSERT_TRUE(attach());
  EXPECT_TRUE(held(*daemon));
  const auto recorder = start_closed({BOLO_PROGRAM, "record", name_, "-o", file("out.h5")});
  EXPECT_TRUE(eventually([&] { return std::filesystem::exists(file("out.h5.part")); }));
  EXPECT_TRUE(held(*recorder));
  expect_good_end(*daemon);
}

TEST_F(BolodRun, AFastReplayLosesNothing) {
  write_capture(folder_ / "in.h5", 400);
  const auto daemon =
      start_with(configure(std::string(kReplay) + "pace = 'fast'\n", "[deblur]\nsolver = 'inverse'\nlookahead = 1\n"));
  EXPECT_EQ(daemon->wait(), 0);
  EXPECT_NE(daemon->err().find(" info: ended: 399 frames in, 399 out, lost: 1 missing;"), std::string::npos)
      << daemon->err();
}

TEST_F(BolodRun, StatShowsARunningDaemon) {
  const auto daemon = start(20'000);
  auto reader = attach();
  ASSERT_TRUE(reader) << daemon->err();
  ReadFrame frame;
  ASSERT_NE(reader->read(20, frame, 60'000), Outcome::kTimeout);
  Program json({BOLO_PROGRAM, "stat", name_, "--once", "--json", "--interval", "0.3"}, folder_ / "json");
  ASSERT_EQ(json.wait(), 0) << json.err();
  const auto object = nlohmann::json::parse(json.out());
  EXPECT_EQ(object["name"], name_);
  EXPECT_EQ(object["state"], "running");
  EXPECT_EQ(object["width"], 64);
  EXPECT_GT(object["published_hz"], 0.0);
  EXPECT_GT(object["latency_max_ms"], 0.0);
  EXPECT_GT(object["stages"]["deblur"]["p50_ms"], 0.0) << object;
  EXPECT_GE(object["stages"]["total"]["max_ms"], object["stages"]["deblur"]["p50_ms"]);
  const auto& efforts = object["effort"]["frames"];
  EXPECT_GT(efforts["full"].get<int>() + efforts["reduced"].get<int>() + efforts["inverse"].get<int>() +
                efforts["raw"].get<int>(),
            0)
      << object;
  Program table({BOLO_PROGRAM, "stat", name_, "--once", "--interval", "0.1"}, folder_ / "table");
  ASSERT_EQ(table.wait(), 0) << table.err();
  EXPECT_NE(table.out().find("Test camera 42, 64x24 at 200 Hz"), std::string::npos) << table.out();
  EXPECT_NE(table.out().find("\nlost     "), std::string::npos) << table.out();
  EXPECT_NE(table.out().find("effort   "), std::string::npos) << table.out();
  EXPECT_NE(table.out().find("stages   arrival"), std::string::npos) << table.out();
  Program unknown({BOLO_PROGRAM, "stat", "no-such-daemon"}, folder_ / "unknown");
  EXPECT_EQ(unknown.wait(), 2);
  Program nuc({BOLO_PROGRAM, "nuc", name_}, folder_ / "nuc");
  EXPECT_EQ(nuc.wait(), 1);
  EXPECT_NE(nuc.err().find("no camera to correct"), std::string::npos) << nuc.err();
  EXPECT_NE(unknown.err().find(name_), std::string::npos) << "the names that exist: " << unknown.err();
}

TEST_F(BolodRun, StatFollowsARestart) {
  auto daemon = start(20'000);
  ASSERT_TRUE(attach());
  Program stat({BOLO_PROGRAM, "stat", name_, "--json", "--interval", "0.1"}, folder_ / "stat");
  ASSERT_TRUE(eventually([&] { return stat.out().find("\"running\"") != std::string::npos; })) << stat.err();
  expect_good_end(*daemon);
  ASSERT_TRUE(eventually([&] { return stat.out().find("\"closed\"") != std::string::npos; }));
  daemon = start_again();
  ASSERT_TRUE(eventually([&] {
    const std::string out = stat.out();
    return out.find("\"running\"", out.rfind("\"closed\"")) != std::string::npos;
  })) << stat.out();
  stat.signal(SIGINT);
  EXPECT_EQ(stat.wait(), 0);
  expect_good_end(*daemon);
}

// Over the network, from the camera that replays: what it sends is what readers get, before it is lost and after.
TEST_F(BolodRun, ACamerasFramesReachAReaderBeforeAndAfterItIsLost) {
  write_capture(folder_ / "in.h5", 90);  // below kLostId: nothing is missing
  const std::string address = own_address();
  auto camera = start_camera(address);
  const auto daemon = start_with(configure(source_at(address, "reconnect_after_ms = 500\n")));
  auto reader = attach();
  ASSERT_TRUE(reader) << daemon->err();

  ReadFrame frame;
  const auto good_frames = [&](int wanted) {
    int good = 0;
    for (std::uint64_t number = reader->published(); good < wanted; ++number) {
      const Outcome outcome = reader->read(number, frame, 60'000);
      if (outcome == Outcome::kOverwritten) continue;
      if (outcome != Outcome::kFrame) break;
      EXPECT_GE(frame.raw[0], kFirstId);
      EXPECT_LT(frame.raw[0], kFirstId + 90);
      std::size_t wrong = 0;
      for (std::size_t i = 1; i < frame.raw.size(); ++i) wrong += frame.raw[i] == scene(i) ? 0U : 1U;
      EXPECT_EQ(wrong, 0U);
      ++good;
    }
    return good;
  };
  EXPECT_EQ(good_frames(50), 50) << daemon->err();
  camera->signal(SIGKILL);
  ASSERT_TRUE(logged(*daemon, "camera lost")) << daemon->err();
  EXPECT_FALSE(reader->closed()) << "a lost camera does not end the daemon";
  camera = nullptr;
  camera = start_camera(address);
  EXPECT_EQ(good_frames(50), 50) << daemon->err();
  ASSERT_TRUE(logged(*daemon, "camera opened again"));
  EXPECT_GT(reader->header().restarts, 0U);
  Program stat({BOLO_PROGRAM, "stat", name_, "--once", "--json", "--interval", "0.1"}, folder_ / "stat");
  ASSERT_EQ(stat.wait(), 0) << stat.err();
  const auto told = nlohmann::json::parse(stat.out())["camera"];
  EXPECT_EQ(told["state"], "streaming") << told;
  EXPECT_EQ(told["lost"]["no_answer"], 1) << told;
  EXPECT_EQ(told["reopened"], 1) << told;
  EXPECT_GT(told["received_packets"], 100) << told;
  Program nuc({BOLO_PROGRAM, "nuc", name_}, folder_ / "nuc");
  EXPECT_EQ(nuc.wait(), 0) << nuc.err();
  EXPECT_TRUE(logged(*daemon, "NUC (asked for)")) << daemon->err();
  EXPECT_TRUE(eventually([&] { return reader->camera()->corrections == 1; }));
  expect_good_end(*daemon);
}

// A camera that sends 180 frames a second where 200 are configured: its own clock's period is what frames are solved
// with. The first pixel rises by 100 counts a frame, which the inverse filter turns into 100 a / (1 - a) counts more,
// a = exp(-period / tau).
TEST_F(BolodRun, FramesAreSolvedWithThePeriodOfTheCamerasClock) {
  write_capture(folder_ / "in.h5", 90, 100);
  const std::string address = own_address();
  const auto camera = start_camera(address, {"--rate", "180"});
  const auto daemon = start_with(
      configure(source_at(address, "true_rate_hz = 200\n"), "[deblur]\nsolver = 'inverse'\ntau_s = 0.011\n"));
  auto reader = attach();
  ASSERT_TRUE(reader) << daemon->err();
  const auto added = [](double rate_hz) {
    const double a = std::exp(-1.0 / (rate_hz * 0.011));
    return 100.0 * a / (1.0 - a);
  };
  ReadFrame frame;
  double last = 0.0;
  for (std::uint64_t number = reader->published(), read = 0; read < 2000; ++number) {
    const Outcome outcome = reader->read(number, frame, 60'000);
    if (outcome == Outcome::kOverwritten) continue;
    ASSERT_EQ(outcome, Outcome::kFrame) << daemon->err();
    ++read;
    const unsigned place =
        (frame.raw[0] - static_cast<unsigned>(kFirstId)) / 100;  // in the capture, which begins again
    if ((frame.meta.flags & (kFlagWarmUp | kFlagGap)) != 0 || place < 30) continue;
    last = static_cast<double>(frame.deblurred[0]) - frame.raw[0];
    if (std::abs(last - added(180.0)) < 2.0) break;
  }
  EXPECT_NEAR(last, added(180.0), 2.0) << "200 Hz would add " << added(200.0) << '\n' << daemon->err();
  EXPECT_TRUE(logged(*daemon, "180 frames come a second, not 200")) << daemon->err();
  expect_good_end(*daemon);
}

}  // namespace
}  // namespace bolo::daemon::bolod_run_test
