// The program without a camera: its options, its words, its exit codes.
#include <gtest/gtest.h>

#include "tests/tools/program.hpp"

namespace bolo::daemon::bolod_test {
namespace {

using tools::test::Outcome;

struct Bolod : tools::test::ProgramTest {
  Bolod() : ProgramTest({BOLOD_PROGRAM}) {}
  std::string config(const std::string& text) const { return write("bolod.toml", text); }
};

bool one_line(const std::string& text) { return !text.empty() && text.find('\n') == text.size() - 1; }

TEST_F(Bolod, CheckConfigSaysOk) {
  const std::string file = config("");
  const Outcome ended = run({"--check-config", "--config", file});
  EXPECT_EQ(ended.exit_code, 0);
  EXPECT_EQ(ended.out, file + ": ok\n");
  EXPECT_EQ(ended.err, "");
}

TEST_F(Bolod, CheckConfigSaysWhatIsWrong) {
  const std::string file = config("[deblur]\nlamda = 1\n");
  const Outcome ended = run({"--check-config", "--config", file});
  EXPECT_EQ(ended.exit_code, 2);
  EXPECT_EQ(ended.err, "bolod: " + file + ":2:1: unknown key 'deblur.lamda'; did you mean 'deblur.lambda'?\n");
}

TEST_F(Bolod, TheShippedConfigurationsAreRight) {
  EXPECT_EQ(run({"--check-config", "--config", BOLO_SOURCE_DIR "/config/bolod.toml"}).exit_code, 0);
  for (const char* camera : {"a655sc", "boson", "lepton"}) {
    const std::string file = config(std::string("profile = '") + BOLO_SOURCE_DIR "/config/" + camera +
                                    ".toml'\n[source]\ntype = 'v4l2'\nrows = [192, 192]\nscale_k = 0.01\n");
    const Outcome checked = run({"--check-config", "--config", file});
    EXPECT_EQ(checked.exit_code, 0) << checked.err;
  }
}

TEST_F(Bolod, AVideoDeviceIsRefusedInOneLine) {
  const auto refused = [&](const std::string& keys, const std::string& why) {
    const std::string file = config("[source]\ntype = 'v4l2'\n" + keys);
    const Outcome ended = run({"--config", file});
    EXPECT_EQ(ended.exit_code, 2);
    EXPECT_NE(ended.err.find(why), std::string::npos) << ended.err;
  };
  refused("device = '/dev/video-that-is-not'\n", "/dev/video-that-is-not: it is not there: plug the camera in");
  refused("device = '/dev/null'\n", "/dev/null: it is no video device");
  refused("device = ''\n", "source.device is empty");
  refused("rows = [3]\n", "source.rows must be [first, count]");
}

TEST_F(Bolod, PrintConfigIsAConfiguration) {
  const Outcome printed = run({"--print-config"});
  EXPECT_EQ(printed.exit_code, 0);
  EXPECT_EQ(run({"--check-config", "--config", config(printed.out)}).exit_code, 0);
}

TEST_F(Bolod, AFullDiskIsNoConfiguration) {
  const std::string program = BOLOD_PROGRAM;
  tools::test::Program full({"/bin/sh", "-c", "exec \"$0\" --print-config > /dev/full", program}, file("full"));
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

TEST_F(Bolod, AnAbsentCameraIsOneLine) {
  // TEST-NET-1 (RFC 5737): no camera ever answers there.
  refused({"--config", config("[source]\naddress = \'192.0.2.1\'\n")}, "192.0.2.1");
}

// systemd restarts after 1 and leaves 2 alone (bolod@.service).
TEST_F(Bolod, AsAServiceItAsksToBeTriedAgainForAnAbsentCameraOnly) {
  ASSERT_EQ(setenv("NOTIFY_SOCKET", "@bolo-test-nobody", 1), 0);
  const Outcome absent = run({"--config", config("[source]\naddress = '192.0.2.1'\n")});
  const Outcome wrong = run({"--config", config("[source]\nadress = '192.0.2.1'\n")});
  unsetenv("NOTIFY_SOCKET");
  EXPECT_EQ(absent.exit_code, 1);
  EXPECT_TRUE(one_line(absent.err)) << absent.err;
  EXPECT_EQ(wrong.exit_code, 2);
}

// What a start refuses for the file's sake, the check refuses, in the same words, and no service manager tries again.
TEST_F(Bolod, AStartRefusesWhatTheCheckRefuses) {
  for (const char* text :
       {"[shm]\nmode = 0o666\n", "[source]\naddress = '999.1.2.3'\n", "[source]\ntype = 'replay'\nfile = 'none.h5'\n",
        "[source]\nwidth = 321\n[v4l2]\nenable = true\nformat = 'yuyv'\n"}) {
    const std::string file = config(text);
    const Outcome checked = run({"--check-config", "--config", file});
    ASSERT_EQ(setenv("NOTIFY_SOCKET", "@bolo-test-nobody", 1), 0);
    const Outcome started = run({"--config", file});
    unsetenv("NOTIFY_SOCKET");
    EXPECT_EQ(checked.exit_code, 2) << text;
    EXPECT_EQ(started.exit_code, 2) << text;
    EXPECT_TRUE(one_line(checked.err)) << checked.err;
    EXPECT_EQ(started.err, checked.err);
  }
}

TEST_F(Bolod, AnAbsentCaptureIsOneLine) {
  refused({"--config", config("[source]\ntype = \'replay\'\nfile = \'none.h5\'\n")}, "none.h5");
}

TEST_F(Bolod, HelpAndVersionEndWell) {
  EXPECT_EQ(run({"--help"}).exit_code, 0);
  EXPECT_NE(run({"--help"}).out.find("--check-config"), std::string::npos);
  EXPECT_EQ(run({"--version"}).out.substr(0, 6), "bolod ");
}

}  // namespace
}  // namespace bolo::daemon::bolod_test
