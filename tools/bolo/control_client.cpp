#include "tools/bolo/control_client.hpp"

#include <sys/socket.h>
#include <sys/un.h>

#include <array>
#include <cerrno>
#include <cstring>

#include <nlohmann/json.hpp>

#include "drivers/shm/shm_object.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::tools {
namespace {

constexpr std::size_t kLongestAnswer = std::size_t{1} << 20U;

Error unreachable(const std::string& path) {
  if (errno == EAGAIN) return {ErrorKind::kFailed, "control socket " + path + ": the daemon did not answer"};
  return {ErrorKind::kBadInput, "control socket " + path + ": " + std::strerror(errno) +
                                    "; is the daemon running, and may this user use it (control.mode)?"};
}

// Anybody may take over the socket name of an ended daemon, and perhaps its folder.
Status check_daemon(int fd, const std::string& path) {
  ucred peer{};
  socklen_t size = sizeof peer;
  if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 && shm::is_trusted(peer.uid)) return {};
  return bad_input("control socket " + path + ": " + shm::describe_user(peer.uid) +
                   " listens there, not bolo, root or this user; if it is your daemon's, set BOLO_USER to that user's "
                   "name or number");
}

}  // namespace

Result<std::string> control_socket_of(const shm::ShmReader& reader, const std::string& name) {
  const auto camera = reader.camera();
  if (!camera || camera->control_socket[0] == '\0') {
    return bad_input("daemon '" + name + "' has no control socket: set control.enable = true");
  }
  return std::string(camera->control_socket);
}

Result<std::string> ask_daemon(const std::string& path, std::string_view request, std::chrono::seconds patience) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  const UniqueFd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const timeval longest{patience.count(), 0};
  setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &longest, sizeof longest);
  setsockopt(fd.get(), SOL_SOCKET, SO_SNDTIMEO, &longest, sizeof longest);  // also if it does not accept
  const std::string line = std::string(request) + "\n";
  if (connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return tl::unexpected<Error>(unreachable(path));
  }
  RETURN_IF_ERROR(check_daemon(fd.get(), path));
  if (send(fd.get(), line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size())) {
    return tl::unexpected<Error>(unreachable(path));
  }
  const auto deadline = std::chrono::steady_clock::now() + patience;
  std::string answer;
  std::array<char, 1024> buffer;
  while (answer.size() < kLongestAnswer && std::chrono::steady_clock::now() < deadline) {
    const ssize_t got = recv(fd.get(), buffer.data(), buffer.size(), 0);
    if (got <= 0) break;
    answer.append(buffer.data(), static_cast<std::size_t>(got));
    if (const std::size_t end = answer.find('\n'); end != std::string::npos) return answer.substr(0, end);
  }
  return failed("control socket " + path + ": the daemon did not answer");
}

Result<std::string> ask_daemon_named(const std::string& name, std::string_view request) {
  ASSIGN_OR_RETURN(const auto reader, shm::ShmReader::open(name));
  ASSIGN_OR_RETURN(const auto path, control_socket_of(reader, name));
  return ask_daemon(path, request);
}

Status judge_answer(const std::string& answer) {
  const auto reply = nlohmann::json::parse(answer, nullptr, false);
  const bool done = reply.is_object() && reply.contains("ok") && reply["ok"] == true;
  if (done) return {};
  const bool has_error = reply.is_object() && reply.contains("error") && reply["error"].is_string();
  return failed(has_error ? reply["error"].get<std::string>() : answer);
}

}  // namespace bolo::tools
