// Who answers at a daemon's control socket: the daemon, or somebody who made a socket of that name.
#include "tools/bolo/control_client.hpp"
#include "tests/drivers/shm/unprivileged.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/sockets.hpp"

namespace bolo::control_client_test {

constexpr std::string_view kAnswer = "{\"ok\": true}\n";

// Answers one request in a daemon's place.
void answer_one(const UniqueFd& listener) {
  const UniqueFd client(accept(listener.get(), nullptr, nullptr));
  std::array<char, 64> request{};
  static_cast<void>(recv(client.get(), request.data(), request.size(), 0));
  static_cast<void>(send(client.get(), kAnswer.data(), kAnswer.size(), MSG_NOSIGNAL));
}

TEST(ControlClientTest, ItsOwnUsersDaemonIsHeard) {
  const Scratch scratch;
  const std::string path = (scratch / "own.sock").string();
  const UniqueFd listener = tools::test::bound_at(path, SOCK_STREAM);
  std::thread daemon([&] { answer_one(listener); });
  const auto answer = tools::ask_daemon(path, "state");
  daemon.join();
  EXPECT_EQ(*must(answer) + "\n", kAnswer);
}

TEST(ControlClientTest, AStrangersSocketIsNotADaemons) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can be another user";
  const Scratch scratch;
  const std::string path = (scratch / "stranger.sock").string();
  std::filesystem::permissions(scratch.path(), std::filesystem::perms::all);
  std::array<int, 2> ready{};
  ASSERT_EQ(pipe(ready.data()), 0);
  std::thread stranger([&] {
    shm::unprivileged({}, [&] {
      const UniqueFd listener = tools::test::bound_at(path, SOCK_STREAM);
      if (write(ready[1], "r", 1) == 1) answer_one(listener);
      return 0;
    });
  });
  char go = 0;
  ASSERT_EQ(read(ready[0], &go, 1), 1);
  const auto answer = tools::ask_daemon(path, "state");
  stranger.join();
  expect_error(answer, {"65534"});
}

}  // namespace bolo::control_client_test
