#include "tools/bolod/control.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <thread>

#include "src/core/clock.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::daemon {
namespace {

constexpr std::size_t kLongestRequest = 256;
constexpr std::int64_t kPatienceNs = 1'000'000'000;  // with a client that does not end its line
constexpr int kBacklog = 8;

bool readable(int fd, std::int64_t timeout_ns) {
  pollfd event{fd, POLLIN, 0};
  return poll(&event, 1, static_cast<int>(timeout_ns / 1'000'000)) > 0;
}

// The first line a client sends, without its end; nothing when it does not end it in time.
std::optional<std::string> read_line(int client) {
  std::string line;
  const std::int64_t deadline_ns = monotonic_ns() + kPatienceNs;
  while (line.size() < kLongestRequest) {
    const std::int64_t left_ns = deadline_ns - monotonic_ns();
    if (left_ns <= 0 || !readable(client, left_ns)) return std::nullopt;
    std::array<char, kLongestRequest> buffer;
    const ssize_t got = recv(client, buffer.data(), buffer.size(), 0);
    if (got <= 0) return std::nullopt;
    line.append(buffer.data(), static_cast<std::size_t>(got));
    if (const std::size_t end = line.find('\n'); end != std::string::npos) return line.substr(0, end);
  }
  return std::nullopt;
}

bool is_listening(const sockaddr_un& address) {
  const UniqueFd probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  return connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

tl::unexpected<Error> cannot(const std::string& path, int code) {
  return bad_input("control socket " + path + ": " + std::strerror(code) +
                   "; set control.socket to a place where the daemon may write, or control.enable = false");
}

}  // namespace

struct ControlServer::Impl {
  Impl(int listen_fd, std::string p, Answer a)
      : listener(listen_fd), stop(eventfd(0, EFD_CLOEXEC)), path(std::move(p)), answer(std::move(a)) {}

  void serve() const {
    for (;;) {
      std::array<pollfd, 2> events{{{listener.get(), POLLIN, 0}, {stop.get(), POLLIN, 0}}};
      if (poll(events.data(), events.size(), -1) < 0 && errno != EINTR) return;
      if ((events[1].revents & POLLIN) != 0) return;
      if ((events[0].revents & POLLIN) == 0) continue;
      const UniqueFd client(accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC));
      if (client) reply(client.get());
    }
  }
  void reply(int client) const {
    const std::optional<std::string> request = read_line(client);
    if (!request) return;
    const std::string text = answer(*request) + "\n";
    std::size_t sent = 0;
    while (sent < text.size()) {  // a client that does not read is not waited for
      const ssize_t n = send(client, text.data() + sent, text.size() - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
      if (n <= 0) return;
      sent += static_cast<std::size_t>(n);
    }
  }

  UniqueFd listener;
  UniqueFd stop;
  std::string path;
  Answer answer;
  std::thread thread;
};

std::string default_control_socket(const std::string& name) {
  const auto given = [](const char* variable) {
    const char* value = std::getenv(variable);
    return std::string(value != nullptr ? value : "");
  };
  std::string folder = given("RUNTIME_DIRECTORY");
  if (folder.empty() && geteuid() == 0) folder = "/run/bolo";
  if (folder.empty() && !given("XDG_RUNTIME_DIR").empty()) folder = given("XDG_RUNTIME_DIR") + "/bolo";
  if (folder.empty()) folder = "/tmp/bolo-" + std::to_string(geteuid());
  return folder + "/" + name + ".sock";
}

Status check_control_socket(const std::string& path) {
  constexpr std::size_t kLongest = sizeof(sockaddr_un::sun_path) - 1;
  if (path.size() <= kLongest) return {};
  return bad_input("control socket " + path + ": longer than " + std::to_string(kLongest) +
                   " letters; set control.socket to a shorter path");
}

Result<std::unique_ptr<ControlServer>> ControlServer::start(const std::string& path, unsigned mode, Answer answer) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (Status status = check_control_socket(path); !status) return tl::unexpected<Error>(status.error());
  path.copy(address.sun_path, path.size());
  std::error_code folder_error;
  const auto folder = std::filesystem::path(path).parent_path();
  if (!folder.empty()) std::filesystem::create_directories(folder, folder_error);
  if (is_listening(address)) return bad_input("control socket " + path + ": another daemon listens there; stop it");
  struct stat there {};
  if (lstat(path.c_str(), &there) == 0 && S_ISSOCK(there.st_mode)) unlink(path.c_str());

  auto impl = std::make_unique<Impl>(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0), path, std::move(answer));
  const int fd = impl->listener.get();
  if (fd < 0 || bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return cannot(path, errno);
  if (chmod(path.c_str(), static_cast<mode_t>(mode)) != 0 || listen(fd, kBacklog) != 0) return cannot(path, errno);
  impl->thread = std::thread([self = impl.get()] { self->serve(); });
  return std::unique_ptr<ControlServer>(new ControlServer(std::move(impl)));
}

ControlServer::ControlServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

ControlServer::~ControlServer() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = write(impl_->stop.get(), &one, sizeof one);
  impl_->thread.join();
  unlink(impl_->path.c_str());
}

}  // namespace bolo::daemon
