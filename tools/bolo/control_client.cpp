#include "tools/bolo/control_client.hpp"

#include <sys/socket.h>
#include <sys/un.h>

#include <array>
#include <cerrno>
#include <cstring>

#include <nlohmann/json.hpp>

#include "src/core/unique_fd.hpp"

namespace bolo::tools {
namespace {

constexpr timeval kPatience{10, 0};  // the daemon itself gives up earlier

Error unreachable(const std::string& path) {
  return {ErrorKind::kBadInput, "control socket " + path + ": " + std::strerror(errno) +
                                    "; is the daemon running, and may this user use it (control.mode)?"};
}

}  // namespace

Result<std::string> control_socket_of(const shm::ShmReader& reader, const std::string& name) {
  const auto camera = reader.camera();
  if (!camera || camera->control_socket[0] == '\0') {
    return bad_input("daemon '" + name + "' has no control socket: set control.enable = true");
  }
  return std::string(camera->control_socket);
}

Result<std::string> ask_daemon(const std::string& path, std::string_view request) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  const UniqueFd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof kPatience);
  const std::string line = std::string(request) + "\n";
  if (connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      send(fd.get(), line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size())) {
    return tl::unexpected<Error>(unreachable(path));
  }
  std::string answer;
  std::array<char, 1024> buffer;
  for (ssize_t got = 0; answer.find('\n') == std::string::npos;
       answer.append(buffer.data(), static_cast<std::size_t>(got))) {
    got = recv(fd.get(), buffer.data(), buffer.size(), 0);
    if (got <= 0) break;
  }
  if (answer.empty()) return failed("control socket " + path + ": the daemon did not answer");
  return answer.substr(0, answer.find('\n'));
}

Result<std::string> ask_daemon_named(const std::string& name, std::string_view request) {
  ASSIGN_OR_RETURN(const auto reader, shm::ShmReader::open(name));
  ASSIGN_OR_RETURN(const auto path, control_socket_of(reader, name));
  return ask_daemon(path, request);
}

Status judge_answer(const std::string& answer) {
  const auto told = nlohmann::json::parse(answer, nullptr, false);
  if (told.is_object() && told.value("ok", false)) return {};
  return failed(told.is_object() ? told.value("error", answer) : answer);
}

}  // namespace bolo::tools
