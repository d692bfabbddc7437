// End to end: capture, bolod, shared memory, reader; signals, names, `bolo stat`.
#include "tests/tools/bolod/bolod_run.hpp"
#include "src/core/frame.hpp"
#include "src/core/loss.hpp"
#include "tests/tools/sockets.hpp"

namespace bolo::daemon::bolod_run_test {

TEST_F(BolodRun, FramesOfACaptureReachAReader) {
  const auto daemon = start(300);
  auto reader = attach(*daemon);
  EXPECT_EQ(reader->header().width, 64U);
  EXPECT_EQ(reader->header().height, 24U);
  EXPECT_STREQ(reader->header().camera_model, "Test camera");

  ReadFrame frame;
  std::uint64_t sharp = 0;
  std::uint64_t with_gap = 0;
  std::uint64_t number = 0;
  for (Outcome outcome = Outcome::kFrame; outcome != Outcome::kClosed; ++number) {
    outcome = reader->read(number, frame, 60'000);
    ASSERT_NE(outcome, Outcome::kTimeout);
    if (outcome != Outcome::kFrame) continue;
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
  EXPECT_GT(sharp, 0U);
  EXPECT_EQ(daemon->wait(), 0) << daemon->err();
  expect_parts(daemon->err(), {"in.h5 Test camera 42, 64x24 at 200 Hz", "frames arrive", "ended: ", "1 missing"});
  const bolo_shm_header header = reader->header();
  EXPECT_EQ(header.lost[static_cast<std::size_t>(LossCause::kMissing)], 1U);
  EXPECT_LE(with_gap, header.gap_frames);
  EXPECT_GT(header.gap_frames, 0U);
}

TEST_F(BolodRun, SigtermEndsItInGoodOrderAndSignalsThatMeanNothingDoNot) {
  const auto daemon = start(100'000 / 5);  // 100 s: only the signal can end it
  auto reader = attach(*daemon);
  ReadFrame frame;
  ASSERT_NE(reader->read(5, frame, 60'000), Outcome::kTimeout);
  for (const int signal : {SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO, SIGPIPE, SIGXFSZ, SIGPWR, SIGRTMIN}) {
    daemon->signal(signal);
  }
  daemon->signal(SIGHUP);
  ASSERT_TRUE(logged(*daemon, "reload: nothing to take up"));
  EXPECT_NE(reader->read(reader->published() + 5, frame, 60'000), Outcome::kClosed) << "SIGHUP does not end it";
  expect_good_end(*daemon);
  EXPECT_TRUE(reader->closed());
  EXPECT_EQ(reader->header().state, std::uint32_t{BOLO_SHM_CLOSED});
  EXPECT_FALSE(ShmReader::open(name_)) << "the name is free again";
  expect_parts(daemon->err(), {"SIGTERM: stopping"});
}

TEST_F(BolodRun, ASecondDaemonOfTheSameNameIsRefused) {
  const auto first = start(20'000);
  auto reader = attach(*first);
  const auto second = start_again("", "second");
  EXPECT_EQ(second->wait(), 2);
  expect_parts(second->err(), {"is written by process"});
  ReadFrame frame;
  EXPECT_NE(reader->read(reader->published() + 5, frame, 60'000), Outcome::kClosed) << "the first one goes on";
  first->signal(SIGINT);
  EXPECT_EQ(first->wait(), 0) << first->err();
}

// The limit applies to shared memory as well: beyond it, report a full /dev/shm instead of dying by SIGXFSZ.
TEST_F(BolodRun, ALimitOnFilesIsAFullDisk) {
  write_capture(folder_ / "in.h5", 100);
  Program limited({"/bin/sh", "-c", "ulimit -f 8; exec \"$0\" --config \"$1\"", BOLOD_PROGRAM, configure(kReplay)},
                  file("limited"));
  EXPECT_EQ(limited.wait(), 2);
  expect_parts(limited.err(), {"/dev/shm has no room"});
  EXPECT_FALSE(std::filesystem::exists("/dev/shm/bolo." + name_));
}

// Under a memory limit the kernel kills a process whose main thread's stack cannot grow when calls go deep.
TEST_F(BolodRun, TheStackHasItsMemoryFromTheBeginning) {
  const auto daemon = start(20'000);
  const auto reader = attach(*daemon);
  std::ifstream status("/proc/" + std::to_string(reader->header().writer_pid) + "/status");
  long stack_kb = 0;
  for (std::string word; status >> word && word != "VmStk:";) {
  }
  status >> stack_kb;
  EXPECT_GE(stack_kb, 1024);
  expect_good_end(*daemon);
}

// Cleaners of temporary files delete sockets.
TEST_F(BolodRun, AControlSocketThatWasTakenAwayIsMadeAgain) {
  const std::string socket = file("control");
  const auto daemon = start(20'000, "[control]\nsocket = '" + socket + "'\n");
  attach(*daemon);
  ended(1, {"nuc", name_}, {"no camera"});
  ASSERT_TRUE(std::filesystem::remove(socket));
  EXPECT_TRUE(eventually([&] { return std::filesystem::exists(socket); })) << daemon->err();
  EXPECT_TRUE(logged(*daemon, "was taken away; it is there again"));
  ended(1, {"nuc", name_}, {"no camera"});
  // Other programs' files are left alone.
  for (const char* which : {"the first time", "and again"}) {
    ASSERT_TRUE(eventually([&] { return std::filesystem::is_socket(socket); })) << daemon->err();
    ASSERT_TRUE(std::filesystem::remove(socket));
    std::ofstream(socket) << "mine";
    EXPECT_TRUE(eventually([&] {
      const std::string log = daemon->err();
      return log.rfind("it is tried again all the time") + 1 > log.rfind("it is there again") + 1;
    })) << which
        << ": " << daemon->err();
    if (which != std::string_view("and again")) std::filesystem::remove(socket);
  }
  expect_good_end(*daemon);
  EXPECT_EQ(tools::test::contents(socket), "mine");
}

// The stopped daemon's socket accepts no more connections, and connecting blocks.
TEST_F(BolodRun, AStoppedDaemonIsNotWaitedForByOthers) {
  const std::string control = "[control]\nsocket = '" + file("control") + "'\n";
  const auto daemon = start(20'000, control);
  attach(*daemon);
  std::vector<UniqueFd> waiting;
  const auto connects = [&] {
    waiting.emplace_back(socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    return tools::test::connect_to(waiting.back(), file("control"));
  };
  ASSERT_TRUE(eventually(connects)) << daemon->err();
  ASSERT_TRUE(daemon->stop());
  waiting.clear();
  while (connects() && waiting.size() < 100) {
  }
  ASSERT_LT(waiting.size(), 100U);
  Program nuc = tools::test::ProgramTest::start({"nuc", name_}, "nuc");
  const auto asked = std::chrono::steady_clock::now();
  expect_parts(tools::test::ProgramTest::printed({"stat", name_, "--once", "--interval", "0.1"}), {name_});
  EXPECT_LT(std::chrono::steady_clock::now() - asked, std::chrono::seconds(10)) << "it was asked twice";
  const std::string own = name_;
  name_ += "-second";
  const auto second = start_again(control, "second");
  name_ = own;
  EXPECT_EQ(second->wait(), 2);
  expect_parts(second->err(), {"another daemon listens there"});
  EXPECT_EQ(nuc.wait(), 1);
  expect_parts(nuc.err(), {"the daemon did not answer"});
  daemon->signal(SIGCONT);
}

// Otherwise a recording's file could receive the printed output.
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
  attach(*daemon);
  EXPECT_TRUE(held(*daemon));
  const auto recorder = start_closed({BOLO_PROGRAM, "record", name_, "-o", file("out.h5")});
  EXPECT_TRUE(eventually([&] { return std::filesystem::exists(file("out.h5.part")); }));
  EXPECT_TRUE(held(*recorder));
  expect_good_end(*daemon);
}

TEST_F(BolodRun, StatShowsARunningDaemon) {
  const auto daemon = start(20'000);
  auto reader = attach(*daemon);
  ReadFrame frame;
  ASSERT_NE(reader->read(20, frame, 60'000), Outcome::kTimeout);
  const auto object = stat();
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
  expect_parts(printed({"stat", name_, "--once", "--interval", "0.1"}),
               {"Test camera 42, 64x24 at 200 Hz", "\nlost     ", "effort   ", "stages   arrival"});
  refused({"stat", "no-such-daemon"}, name_);  // existing names
  ended(1, {"nuc", name_}, {"no camera to correct"});
}

// Over the network with the fake camera: readers get the camera's frames, before it is lost and after.
TEST_F(BolodRun, ACamerasFramesReachAReaderBeforeAndAfterItIsLost) {
  write_capture(folder_ / "in.h5", 90);  // below kLostId: no gap
  const std::string address = own_address();
  auto camera = start_camera(address);
  const auto daemon = start_with(configure(source_at(address, "reconnect_after_ms = 500\n")));
  auto reader = attach(*daemon);

  const auto good_frames = [&reader](int wanted) {
    return follow(*reader, [&wanted](const ReadFrame& frame) {
      EXPECT_GE(frame.raw[0], kFirstId);
      EXPECT_LT(frame.raw[0], kFirstId + 90);
      std::size_t wrong = 0;
      for (std::size_t i = 1; i < frame.raw.size(); ++i) wrong += frame.raw[i] == scene(i) ? 0U : 1U;
      EXPECT_EQ(wrong, 0U);
      return --wanted == 0;
    });
  };
  EXPECT_TRUE(good_frames(50)) << daemon->err();
  camera->signal(SIGKILL);
  ASSERT_TRUE(logged(*daemon, "camera lost")) << daemon->err();
  EXPECT_FALSE(reader->closed()) << "a lost camera does not end the daemon";
  camera = nullptr;
  camera = start_camera(address);
  EXPECT_TRUE(good_frames(50)) << daemon->err();
  ASSERT_TRUE(logged(*daemon, "camera opened again"));
  EXPECT_GT(reader->header().restarts, 0U);
  const auto status = stat()["camera"];
  EXPECT_EQ(status["state"], "streaming") << status;
  EXPECT_EQ(status["lost"]["no_answer"], 1) << status;
  EXPECT_EQ(status["reopened"], 1) << status;
  EXPECT_GT(status["received_packets"], 100) << status;
  done({"nuc", name_});
  EXPECT_TRUE(logged(*daemon, "NUC (asked for)")) << daemon->err();
  EXPECT_TRUE(eventually([&] { return reader->camera()->corrections == 1; }));
  expect_good_end(*daemon);
}

// The first pixel rises by 100 counts a frame, to which the inverse filter adds 100 a / (1 - a) counts, a = exp(-period
// / tau).
struct FollowsPeriod : BolodRun {
  // The first pixel's counts give the frame's place in the capture: counts / 100.
  void expect_solved_at(double rate_hz, double wrong_hz, const Program& daemon) {
    auto reader = attach(daemon);
    const auto added = [](double hz) {
      const double a = std::exp(-1.0 / (hz * 0.011));
      return 100.0 * a / (1.0 - a);
    };
    double last = 0.0;
    int read = 0;
    EXPECT_TRUE(follow(*reader, [&](const ReadFrame& frame) {
      const auto place = (frame.raw[0] - static_cast<unsigned>(kFirstId)) / 100;  // in the capture, which is looped
      const bool counts = (frame.meta.flags & (kFlagWarmUp | kFlagGap)) == 0 && place >= 30;
      if (counts) last = static_cast<double>(frame.deblurred[0]) - frame.raw[0];
      return (counts && std::abs(last - added(rate_hz)) < 2.0) || ++read == 2000;
    })) << daemon.err();
    EXPECT_NEAR(last, added(rate_hz), 2.0) << wrong_hz << " Hz would add " << added(wrong_hz) << '\n' << daemon.err();
    EXPECT_NEAR(attach(daemon)->header().frame_period_s, 1.0 / rate_hz, 1e-5) << "what recordings begun now state";
  }
};

// A camera sends 180 frames a second instead of the configured 200: frames are solved with the period of its own clock.
TEST_F(FollowsPeriod, FramesAreSolvedWithThePeriodOfTheCamerasClock) {
  write_capture(folder_ / "in.h5", 90, 100);
  const std::string address = own_address();
  const auto camera = start_camera(address, {"--rate", "180"});
  const auto daemon = start_with(
      configure(source_at(address, "true_rate_hz = 200\n"), "[deblur]\nsolver = 'inverse'\ntau_s = 0.011\n"));
  expect_solved_at(180.0, 200.0, *daemon);
  EXPECT_TRUE(logged(*daemon, "180 frames come a second, not 200")) << daemon->err();
  expect_good_end(*daemon);
}

// A 100 Hz camera that is read at 200 Hz.
TEST_F(FollowsPeriod, FramesThatComeTwiceAreSolvedWithThePeriodOfTheNewOnes) {
  write_capture(folder_ / "in.h5", 90, 100, "42", 2);
  write("drop.toml", "[firmware]\ndrop_repeated = true\n");
  const std::string address = own_address();
  const auto camera = start_camera(address, {"--rate", "200"});
  const std::string source = source_at(address, "rate_hz = 200\n");
  const auto daemon = start_with(
      write("drop-bolod.toml", "name = '" + name_ + "'\nprofile = 'drop.toml'\n[source]\n" + source +
                                   "[pipeline]\nlock_memory = false\n[deblur]\nsolver = 'inverse'\ntau_s = 0.011\n"));
  expect_solved_at(100.0, 200.0, *daemon);
  EXPECT_TRUE(logged(*daemon, "100 new frames come a second, not 200")) << daemon->err();
  expect_good_end(*daemon);
}

using tools::test::Outcome;

// --- The program without a camera: options, messages, exit codes.

struct Bolod : tools::test::ProgramTest {
  Bolod() : ProgramTest({BOLOD_PROGRAM}) {}
  std::string config(const std::string& text) const { return write("bolod.toml", text); }
};

TEST_F(Bolod, CheckConfigSaysOkOrWhatIsWrong) {
  const std::string good = config("");
  EXPECT_EQ(printed({"--check-config", "--config", good}), good + ": ok\n");
  refused({"--check-config", "--config", config("[deblur]\nlamda = 1\n")},
          "bolod: " + good + ":2:1: unknown key 'deblur.lamda'; did you mean 'deblur.lambda'?\n");
}

TEST_F(Bolod, TheShippedConfigurationsAreRight) {
  done({"--check-config", "--config", BOLO_SOURCE_DIR "/config/bolod.toml"});
  done({"--check-config", "--config", config(printed({"--print-config"}))});
  for (const char* camera : {"a655sc", "boson", "lepton"}) {
    done({"--check-config", "--config",
          config(std::string("profile = '") + BOLO_SOURCE_DIR "/config/" + camera +
                 ".toml'\n[source]\ntype = 'v4l2'\nrows = [192, 192]\nscale_k = 0.01\n")});
  }
}

TEST_F(Bolod, AProfileIsNoConfiguration) {
  for (const std::string camera : {"a655sc", "boson", "lepton"}) {
    refused({"--check-config", "--config", std::string(BOLO_SOURCE_DIR "/config/") + camera + ".toml"},
            "this is a camera's profile: a configuration names it, profile = '" + camera + ".toml'");
  }
}

TEST_F(Bolod, ACpuThatIsNotThereIsRefused) {
  done({"--check-config", "--config", config("[pipeline]\ncpus = [0]\n")});
  for (const std::vector<std::string>& more : {std::vector<std::string>{}, {"--check-config"}}) {
    std::vector<std::string> words{"--config", config("[pipeline]\ncpus = [0, 4000]\n")};
    words.insert(words.end(), more.begin(), more.end());
    refused(words, "pipeline.cpus names CPU 4000, which this computer has not");
  }
}

TEST_F(Bolod, ASourceThatCannotBeIsRefusedInOneLine) {
  const auto refuses = [&](const std::string& keys, const std::string& why) {
    refused({"--config", config("[source]\n" + keys)}, why);
  };
  const std::string video = "type = 'v4l2'\n";
  refuses(video + "device = '/dev/video-that-is-not'\n", "/dev/video-that-is-not: it is not there: plug the camera in");
  refuses(video + "device = '/dev/null'\n", "/dev/null: it is no video device");
  refuses(video + "device = ''\n", "source.device is empty");
  refuses(video + "rows = [3]\n", "source.rows must be [first, count]");
  refuses("type = 'replay'\nfile = 'none.h5'\n", "none.h5");
  refuses("address = '192.0.2.1'\n", "192.0.2.1");  // TEST-NET-1 (RFC 5737): no camera answers there
}

TEST_F(Bolod, AFullDiskIsNoConfiguration) {
  tools::test::Program full({"/bin/sh", "-c", "exec \"$0\" --print-config > /dev/full", BOLOD_PROGRAM}, file("full"));
  EXPECT_EQ(full.wait(), 1);
  EXPECT_EQ(full.err(), "bolod: standard output cannot be written\n");
}

TEST_F(Bolod, WrongUsageIsOneLine) {
  refused({}, "--config FILE is missing");
  refused({"--confg", "x"}, "confg");
  refused({"--config"}, "config");
  refused({"--config", "x", "y"}, "unexpected argument 'y'");
  refused({"--config", "/nonexistent.toml"}, "/nonexistent.toml: no such file");
}

// systemd restarts after exit code 1, not after 2 (bolod@.service). The check refuses the same files as a start, with
// the same messages.
TEST_F(Bolod, AsAServiceItAsksToBeTriedAgainForAnAbsentCameraOnly) {
  ASSERT_EQ(setenv("NOTIFY_SOCKET", "@bolo-test-nobody", 1), 0);
  const Outcome absent = run({"--config", config("[source]\naddress = '192.0.2.1'\n")});
  EXPECT_EQ(absent.exit_code, 1);
  EXPECT_EQ(absent.err.find('\n'), absent.err.size() - 1) << absent.err;
  for (const char* text : {"[source]\nadress = '192.0.2.1'\n", "[shm]\nmode = 0o666\n",
                           "[source]\naddress = '999.1.2.3'\n", "[source]\ntype = 'replay'\nfile = 'none.h5'\n",
                           "[source]\nwidth = 321\n[v4l2]\nenable = true\nformat = 'yuyv'\n"}) {
    const std::string file = config(text);
    refused({"--config", file}, run({"--check-config", "--config", file}).err);
  }
  unsetenv("NOTIFY_SOCKET");
}

TEST_F(Bolod, HelpAndVersionEndWell) {
  expect_parts(printed({"--help"}), {"--check-config"});
  EXPECT_TRUE(printed({"--version"}).starts_with("bolod "));
}

}  // namespace bolo::daemon::bolod_run_test
