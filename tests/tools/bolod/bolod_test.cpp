// The program without a camera: its options, its words, its exit codes.
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/tools/bolod/process.hpp"

namespace bolo::daemon {
namespace {

using testing_tools::Process;

struct Ended {
  int code = -1;
  std::string out;
  std::string err;
};

class Bolod : public testing::Test {
 protected:
  Bolod() : folder_(testing::TempDir() + "bolod-" + std::to_string(getpid())) {
    std::filesystem::create_directory(folder_);
  }
  ~Bolod() override { std::filesystem::remove_all(folder_); }

  std::string write(const std::string& text) const {
    const std::string file = folder_ / "bolod.toml";
    std::ofstream(file) << text;
    return file;
  }

  Ended run(std::vector<std::string> argv) const {
    argv.insert(argv.begin(), BOLOD_PROGRAM);
    Process process(argv, folder_ / "log");
    const int code = process.wait();
    return {code, process.out(), process.err()};
  }

  std::filesystem::path folder_;
};

bool one_line(const std::string& text) { return !text.empty() && text.find('\n') == text.size() - 1; }

TEST_F(Bolod, CheckConfigSaysOk) {
  const std::string file = write("");
  const Ended ended = run({"--check-config", "--config", file});
  EXPECT_EQ(ended.code, 0);
  EXPECT_EQ(ended.out, file + ": ok\n");
  EXPECT_EQ(ended.err, "");
}

TEST_F(Bolod, CheckConfigSaysWhatIsWrong) {
  const std::string file = write("[deblur]\nlamda = 1\n");
  const Ended ended = run({"--check-config", "--config", file});
  EXPECT_EQ(ended.code, 2);
  EXPECT_EQ(ended.err, "bolod: " + file + ":2:1: unknown key 'deblur.lamda'; did you mean 'deblur.lambda'?\n");
}

TEST_F(Bolod, TheShippedConfigurationsAreRight) {
  EXPECT_EQ(run({"--check-config", "--config", BOLO_SOURCE_DIR "/config/bolod.toml"}).code, 0);
  const std::string file = write("profile = '" BOLO_SOURCE_DIR "/config/a655sc.toml'\n");
  EXPECT_EQ(run({"--check-config", "--config", file}).code, 0);
}

TEST_F(Bolod, PrintConfigIsAConfiguration) {
  const Ended printed = run({"--print-config"});
  EXPECT_EQ(printed.code, 0);
  EXPECT_EQ(run({"--check-config", "--config", write(printed.out)}).code, 0);
}

TEST_F(Bolod, WrongUsageIsOneLine) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{}, "--config FILE is missing"},
      {{"--confg", "x"}, "confg"},
      {{"--config"}, "config"},
      {{"--config", "x", "y"}, "unexpected argument 'y'"},
      {{"--config", "/nonexistent.toml"}, "/nonexistent.toml: no such file"},
  };
  for (const auto& [argv, expected] : cases) {
    const Ended ended = run(argv);
    EXPECT_EQ(ended.code, 2) << expected;
    EXPECT_TRUE(one_line(ended.err)) << ended.err;
    EXPECT_NE(ended.err.find(expected), std::string::npos) << ended.err;
  }
}

TEST_F(Bolod, AnAbsentCameraIsOneLine) {
  // TEST-NET-1 (RFC 5737): no camera ever answers there.
  const Ended ended = run({"--config", write("[source]\naddress = '192.0.2.1'\n")});
  EXPECT_EQ(ended.code, 2);
  EXPECT_TRUE(one_line(ended.err)) << ended.err;
  EXPECT_NE(ended.err.find("192.0.2.1"), std::string::npos) << ended.err;
}

// systemd restarts after 1 and leaves 2 alone (bolod@.service).
TEST_F(Bolod, AsAServiceItAsksToBeTriedAgainForAnAbsentCameraOnly) {
  ASSERT_EQ(setenv("NOTIFY_SOCKET", "@bolo-test-nobody", 1), 0);
  const Ended absent = run({"--config", write("[source]\naddress = '192.0.2.1'\n")});
  const Ended wrong = run({"--config", write("[source]\nadress = '192.0.2.1'\n")});
  unsetenv("NOTIFY_SOCKET");
  EXPECT_EQ(absent.code, 1);
  EXPECT_TRUE(one_line(absent.err)) << absent.err;
  EXPECT_EQ(wrong.code, 2);
}

// What a start refuses for the file's sake, the check refuses, in the same words, and no service manager tries again.
TEST_F(Bolod, AStartRefusesWhatTheCheckRefuses) {
  for (const char* text :
       {"[shm]\nmode = 0o666\n", "[source]\naddress = '999.1.2.3'\n", "[source]\ntype = 'replay'\nfile = 'none.h5'\n",
        "[source]\nwidth = 321\n[v4l2]\nenable = true\nformat = 'yuyv'\n"}) {
    const std::string file = write(text);
    const Ended checked = run({"--check-config", "--config", file});
    ASSERT_EQ(setenv("NOTIFY_SOCKET", "@bolo-test-nobody", 1), 0);
    const Ended started = run({"--config", file});
    unsetenv("NOTIFY_SOCKET");
    EXPECT_EQ(checked.code, 2) << text;
    EXPECT_EQ(started.code, 2) << text;
    EXPECT_TRUE(one_line(checked.err)) << checked.err;
    EXPECT_EQ(started.err, checked.err);
  }
}

TEST_F(Bolod, AnAbsentCaptureIsOneLine) {
  const Ended ended = run({"--config", write("[source]\ntype = 'replay'\nfile = 'none.h5'\n")});
  EXPECT_EQ(ended.code, 2);
  EXPECT_TRUE(one_line(ended.err)) << ended.err;
  EXPECT_NE(ended.err.find("none.h5"), std::string::npos) << ended.err;
}

TEST_F(Bolod, HelpAndVersionEndWell) {
  EXPECT_EQ(run({"--help"}).code, 0);
  EXPECT_NE(run({"--help"}).out.find("--check-config"), std::string::npos);
  EXPECT_EQ(run({"--version"}).out.substr(0, 6), "bolod ");
}

}  // namespace
}  // namespace bolo::daemon
