// Idle clients, clients that do not read, and too many of them: others are still answered.
#include "tools/bolod/request_server.hpp"

#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>

#include "tests/no_threads.hpp"
#include "tests/tools/program.hpp"
#include "tests/tools/sockets.hpp"
#include "tools/bolod/control.hpp"
#include "tools/bolod/metrics.hpp"

namespace bolo::daemon::request_server_test {

std::function<void()> g_after_bind;  // called once

}  // namespace bolo::daemon::request_server_test

extern "C" int bind(int descriptor, const sockaddr* address, socklen_t bytes) noexcept {
  const auto result = static_cast<int>(syscall(SYS_bind, descriptor, address, bytes));
  if (std::function<void()>& after = bolo::daemon::request_server_test::g_after_bind) std::exchange(after, nullptr)();
  return result;
}

namespace bolo::daemon::request_server_test {

using namespace tools::test;

constexpr int kForEver_ms = 600'000;  // longer than any test

class RequestServerTest : public ScratchTest {
 protected:
  // Answers "LINE\n" with "LINE LINE\n".
  void serve(const RequestServer::Limits& limits) {
    server_.emplace(listener(), limits, [](std::string_view received) -> std::optional<std::string> {
      const std::size_t end = received.find('\n');
      if (end == std::string_view::npos) return std::nullopt;
      const std::string line(received.substr(0, end));
      return line + " " + line + "\n";
    });
  }
  UniqueFd listener() const { return bound_at(path_, SOCK_STREAM, SOCK_NONBLOCK); }
  UniqueFd connected() const {
    UniqueFd fd = patient_socket(AF_UNIX);
    EXPECT_TRUE(connect_to(fd, path_));
    return fd;
  }
  std::string answer_to(std::string_view text) const {
    const UniqueFd fd = connected();
    send_text(fd, text);
    return receive_all(fd);
  }

  const std::string path_ = (scratch_.path() / "s").string();
  std::optional<RequestServer> server_;
};

TEST_F(RequestServerTest, SilentClientsKeepNobodyWaiting) {
  serve({.clients = 16, .patience_ms = kForEver_ms});
  std::vector<UniqueFd> silent;
  for (int i = 0; i < 8; ++i) silent.push_back(connected());
  send_text(silent[0], "half a li");
  EXPECT_EQ(answer_to("one\n"), "one one\n");
  send_text(silent[0], "ne\n");
  EXPECT_EQ(receive_all(silent[0]), "half a line half a line\n") << "a slow one too, in its time";
}

TEST_F(RequestServerTest, WhereAllPlacesAreTakenTheOldestMakesRoom) {
  serve({.clients = 4, .patience_ms = kForEver_ms});
  std::vector<UniqueFd> silent;
  for (int i = 0; i < 20; ++i) silent.push_back(connected());
  EXPECT_EQ(answer_to("one\n"), "one one\n");
  EXPECT_EQ(receive_all(silent[0]), "") << "let go";
}

TEST_F(RequestServerTest, WhoSaysNothingOrTooMuchIsLetGo) {
  serve({.clients = 16, .patience_ms = 50, .longest_request = 100});
  EXPECT_EQ(receive_all(connected()), "");
  EXPECT_EQ(answer_to(std::string(101, 'a')), "");
  EXPECT_EQ(answer_to("one\n"), "one one\n");
}

TEST_F(RequestServerTest, WhoDoesNotReadDelaysNobodyAndIsLetGo) {
  serve({.clients = 16, .patience_ms = 300, .longest_request = 4 << 20});
  const UniqueFd deaf = connected();
  send_text(deaf, std::string(1 << 20, 'a') + "\n");
  EXPECT_EQ(answer_to("one\n"), "one one\n");
  EXPECT_NE(receive_all(deaf), "?");
}

// Without file descriptors accept() fails and the listener stays readable.
TEST_F(RequestServerTest, WithoutDescriptorsItDoesNotSpin) {
  serve({.clients = 16, .patience_ms = kForEver_ms});
  const UniqueFd early = connected();
  const UniqueFd late = connected();
  send_text(late, "one\n");
  EXPECT_EQ(receive_all(late), "one one\n");  // both are accepted
  rlimit before{};
  getrlimit(RLIMIT_NOFILE, &before);
  const UniqueFd waiting = patient_socket(AF_UNIX);
  const UniqueFd last(dup(waiting.get()));  // lowest free descriptor: all below are used
  const rlimit none{static_cast<rlim_t>(last.get()) + 1, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  const auto cpu_ms = [] {
    timespec used{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
    return static_cast<double>(used.tv_sec) * 1e3 + static_cast<double>(used.tv_nsec) * 1e-6;
  };
  const double begin_ms = cpu_ms();
  const bool connected = connect_to(waiting, path_);
  std::this_thread::sleep_for(std::chrono::milliseconds(1000));
  const double used_ms = cpu_ms() - begin_ms;
  setrlimit(RLIMIT_NOFILE, &before);
  ASSERT_TRUE(connected);
  EXPECT_LT(used_ms, 20.0) << "of a second";
  send_text(waiting, "two\n");
  EXPECT_EQ(receive_all(waiting), "two two\n") << "as soon as there are some again";
}

// A server started without a free descriptor serves later, and can be stopped.
TEST_F(RequestServerTest, WithoutDescriptorsAtTheStartItStillEnds) {
  serve({.clients = 16, .patience_ms = kForEver_ms});  // sanitizers need a descriptor the first time they check a type
  server_.reset();
  std::filesystem::remove(path_);
  UniqueFd bound = listener();
  rlimit before{};
  getrlimit(RLIMIT_NOFILE, &before);
  UniqueFd last(dup(bound.get()));  // lowest free descriptor: all below are used
  const rlimit none{static_cast<rlim_t>(last.get()) + 1, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  server_.emplace(std::move(bound), RequestServer::Limits{.clients = 16, .patience_ms = kForEver_ms},
                  [](std::string_view) { return "yes"; });
  setrlimit(RLIMIT_NOFILE, &before);
  last = UniqueFd();
  EXPECT_EQ(answer_to("one\n"), "yes");
  server_.reset();
}

// /tmp is writable by everybody: an existing folder may belong to somebody who lies in wait for the socket.
TEST(ControlServer, AnothersFolderIsRefused) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root, to give a folder away";
  constexpr uid_t kNobody = 65534;
  const Scratch scratch;
  const std::string folder = (scratch.path() / "bolo-0").string();
  const auto start = [&] {
    return ControlServer::start(folder + "/cam.sock", 0660, [](std::string_view) { return "{}"; });
  };
  ASSERT_TRUE(start()) << "a folder of its own making";
  ASSERT_EQ(chown(folder.c_str(), kNobody, kNobody), 0);
  expect_error(start(), {folder + " belongs to user nobody (uid 65534)"});
  ASSERT_EQ(chown(folder.c_str(), 0, 0), 0);
  ASSERT_EQ(chmod(folder.c_str(), 0777), 0);
  EXPECT_FALSE(start()) << "everybody's";
  ASSERT_EQ(chmod(folder.c_str(), 01777), 0);
  EXPECT_TRUE(start()) << "everybody's, but files are their owners'";
}

// Race: with write access to the parent folder, a user replaces it before the socket gets its mode.
TEST(ControlServer, AnothersFileDoesNotGetTheSocketsMode) {
  const Scratch scratch;
  const std::filesystem::path folder = scratch / "folder";
  const std::filesystem::path theirs = scratch / "theirs";
  std::filesystem::create_directories(folder);
  std::ofstream(theirs) << "theirs";
  ASSERT_EQ(chmod(theirs.c_str(), 0600), 0);
  g_after_bind = [&] {
    std::filesystem::rename(folder, scratch / "moved");
    std::filesystem::create_directories(folder);
    std::filesystem::create_symlink(theirs, folder / "cam.sock");
  };
  EXPECT_FALSE(ControlServer::start(folder / "cam.sock", 0666, [](std::string_view) { return "{}"; }));
  EXPECT_FALSE(g_after_bind) << "it was called";
  EXPECT_EQ(std::filesystem::status(theirs).permissions(), std::filesystem::perms(0600));
}

TEST(ControlServer, AFileInItsPlaceStaysAndIsNamed) {
  const Scratch scratch;
  const std::filesystem::path path = scratch.text("cam.sock", "theirs");
  expect_refused(ControlServer::start(path, 0660, [](std::string_view) { return "{}"; }),
                 {path.string() + ": a file that is no socket is there; remove it, or set control.socket"});
  EXPECT_EQ(std::filesystem::file_size(path), 6U);
}

TEST(RequestServers, WithoutAThreadThereIsAnErrorAndNoSocket) {
  const NoThreads none;
  const Scratch scratch;
  const std::string path = (scratch.path() / "s").string();
  const auto control = ControlServer::start(path, 0600, [](std::string_view) { return "{}"; });
  const auto metrics = metrics_server({true, tools::test::own_address() + ":9464", false},
                                      [] { return std::vector<prometheus::MetricFamily>(); });
  expect_error(control, {"no thread"});
  EXPECT_FALSE(std::filesystem::exists(path));
  expect_error(metrics, {"no thread"});
}

}  // namespace bolo::daemon::request_server_test
