// Clients that say nothing, do not read, or are too many: others are answered all the same.
#include "tools/bolod/request_server.hpp"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/program.hpp"
#include "tools/bolod/control.hpp"
#include "tools/bolod/metrics_server.hpp"

namespace bolo::daemon::request_server_test {
namespace {

constexpr int kForEver_ms = 600'000;  // longer than any test

sockaddr_un place_of(const std::string& path) {
  sockaddr_un place{};
  place.sun_family = AF_UNIX;
  path.copy(place.sun_path, sizeof place.sun_path - 1);
  return place;
}

class RequestServerTest : public testing::Test {
 protected:
  // Answers "LINE\n" with "LINE LINE\n".
  void serve(const RequestServer::Limits& limits) {
    UniqueFd listener(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    const sockaddr_un place = place_of(path_);
    ASSERT_EQ(bind(listener.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place), 0);
    ASSERT_EQ(listen(listener.get(), 64), 0);
    server_.emplace(std::move(listener), limits, [](std::string_view received) -> std::optional<std::string> {
      const std::size_t end = received.find('\n');
      if (end == std::string_view::npos) return std::nullopt;
      const std::string line(received.substr(0, end));
      return line + " " + line + "\n";
    });
  }
  UniqueFd connected() const {
    UniqueFd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const sockaddr_un place = place_of(path_);
    const timeval patience{30, 0};  // a guard against hanging
    setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    EXPECT_EQ(connect(fd.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place), 0);
    return fd;
  }
  static void say(const UniqueFd& fd, std::string_view text) {
    EXPECT_EQ(send(fd.get(), text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }
  // All until the server ends the connection; "?" where it does not.
  static std::string hear(const UniqueFd& fd) {
    std::string all;
    std::array<char, 4096> part;
    ssize_t got = 0;
    while ((got = recv(fd.get(), part.data(), part.size(), 0)) > 0) {
      all.append(part.data(), static_cast<std::size_t>(got));
    }
    return got == 0 || errno == ECONNRESET ? all : "?";
  }
  std::string answer_to(std::string_view text) const {
    const UniqueFd fd = connected();
    say(fd, text);
    return hear(fd);
  }

  const Scratch scratch_;
  const std::string path_ = (scratch_.path() / "s").string();
  std::optional<RequestServer> server_;
};

TEST_F(RequestServerTest, SilentClientsKeepNobodyWaiting) {
  serve({.clients = 16, .patience_ms = kForEver_ms});
  std::vector<UniqueFd> silent;
  for (int i = 0; i < 8; ++i) silent.push_back(connected());
  say(silent[0], "half a li");
  EXPECT_EQ(answer_to("one\n"), "one one\n");
  say(silent[0], "ne\n");
  EXPECT_EQ(hear(silent[0]), "half a line half a line\n") << "a slow one too, in its time";
}

TEST_F(RequestServerTest, WhereAllPlacesAreTakenTheOldestMakesRoom) {
  serve({.clients = 4, .patience_ms = kForEver_ms});
  std::vector<UniqueFd> silent;
  for (int i = 0; i < 20; ++i) silent.push_back(connected());
  EXPECT_EQ(answer_to("one\n"), "one one\n");
  EXPECT_EQ(hear(silent[0]), "") << "let go";
}

TEST_F(RequestServerTest, WhoSaysNothingOrTooMuchIsLetGo) {
  serve({.clients = 16, .patience_ms = 50, .longest_request = 100});
  EXPECT_EQ(hear(connected()), "");
  EXPECT_EQ(answer_to(std::string(101, 'a')), "");
  EXPECT_EQ(answer_to("one\n"), "one one\n");
}

TEST_F(RequestServerTest, WhoDoesNotReadDelaysNobodyAndIsLetGo) {
  serve({.clients = 16, .patience_ms = 300, .longest_request = 4 << 20});
  const UniqueFd deaf = connected();
  say(deaf, std::string(1 << 20, 'a') + "\n");
  EXPECT_EQ(answer_to("one\n"), "one one\n");
  EXPECT_NE(hear(deaf), "?");
}

// A process without descriptors can't accept, and its listener stays readable.
TEST_F(RequestServerTest, WithoutDescriptorsItDoesNotSpin) {
  serve({.clients = 16, .patience_ms = kForEver_ms});
  const UniqueFd early = connected();
  const UniqueFd late = connected();
  say(late, "one\n");
  EXPECT_EQ(hear(late), "one one\n");  // both are accepted
  rlimit before{};
  getrlimit(RLIMIT_NOFILE, &before);
  const UniqueFd waiting(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const UniqueFd last(dup(waiting.get()));  // the lowest that was free: all below are taken
  const rlimit none{static_cast<rlim_t>(last.get()) + 1, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  const sockaddr_un place = place_of(path_);
  const auto cpu_ms = [] {
    timespec used{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
    return static_cast<double>(used.tv_sec) * 1e3 + static_cast<double>(used.tv_nsec) * 1e-6;
  };
  const double begin_ms = cpu_ms();
  const int connect_result = connect(waiting.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place);
  std::this_thread::sleep_for(std::chrono::milliseconds(1000));
  const double used_ms = cpu_ms() - begin_ms;
  setrlimit(RLIMIT_NOFILE, &before);
  ASSERT_EQ(connect_result, 0);
  EXPECT_LT(used_ms, 20.0) << "of a second";
  say(waiting, "two\n");
  const timeval patience{30, 0};
  setsockopt(waiting.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  EXPECT_EQ(hear(waiting), "two two\n") << "as soon as there are some again";
}

// One that was started when the process had no descriptor left serves, and ends when it is told to.
TEST_F(RequestServerTest, WithoutDescriptorsAtTheStartItStillEnds) {
  UniqueFd listener(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const sockaddr_un place = place_of(path_);
  ASSERT_EQ(bind(listener.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place), 0);
  ASSERT_EQ(listen(listener.get(), 64), 0);
  rlimit before{};
  getrlimit(RLIMIT_NOFILE, &before);
  UniqueFd last(dup(listener.get()));  // the lowest that was free: all below are taken
  const rlimit none{static_cast<rlim_t>(last.get()) + 1, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  server_.emplace(std::move(listener), RequestServer::Limits{.clients = 16, .patience_ms = kForEver_ms},
                  [](std::string_view) { return "yes"; });
  setrlimit(RLIMIT_NOFILE, &before);
  last = UniqueFd();
  EXPECT_EQ(answer_to("one\n"), "yes");
  server_.reset();
}

// /tmp is everybody's: a folder that was there first may be somebody's who waits for a daemon's socket.
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
  const auto anothers = start();
  ASSERT_FALSE(anothers);
  EXPECT_NE(anothers.error().message.find(folder + " belongs to user nobody (uid 65534)"), std::string::npos)
      << anothers.error().message;
  ASSERT_EQ(chown(folder.c_str(), 0, 0), 0);
  ASSERT_EQ(chmod(folder.c_str(), 0777), 0);
  EXPECT_FALSE(start()) << "everybody's";
  ASSERT_EQ(chmod(folder.c_str(), 01777), 0);
  EXPECT_TRUE(start()) << "everybody's, but files are their owners'";
}

// A thread may be refused at any time, as when all that the service may have are taken. A stack that no computer has
// room for stands for it.
TEST(RequestServers, WithoutAThreadThereIsAnErrorAndNoSocket) {
  pthread_attr_t before{};
  pthread_attr_t huge{};
  ASSERT_EQ(pthread_getattr_default_np(&before), 0);
  pthread_attr_init(&huge);
  ASSERT_EQ(pthread_attr_setstacksize(&huge, std::size_t{1} << 46), 0);
  ASSERT_EQ(pthread_setattr_default_np(&huge), 0);
  const Scratch scratch;
  const std::string path = (scratch.path() / "s").string();
  const auto control = ControlServer::start(path, 0600, [](std::string_view) { return "{}"; });
  const auto metrics = MetricsServer::start({true, tools::test::own_address() + ":9464", false},
                                            [] { return std::vector<prometheus::MetricFamily>(); });
  pthread_setattr_default_np(&before);
  expect_error(control, {"no thread"});
  EXPECT_FALSE(std::filesystem::exists(path));
  expect_error(metrics, {"no thread"});
}

}  // namespace
}  // namespace bolo::daemon::request_server_test
