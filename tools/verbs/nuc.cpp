// `bolo nuc`: has a running daemon's camera correct its pixels now.
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include "drivers/shm/shm_reader.hpp"
#include "tools/verbs/cli.hpp"
#include "tools/verbs/verbs.hpp"

namespace bolo::tools {
namespace {

constexpr timeval kPatience{10, 0};  // the daemon itself gives up earlier

Result<std::string> socket_of(const std::string& name) {
  const auto reader = shm::ShmReader::open(name);
  if (!reader) return tl::unexpected<Error>(reader.error());
  const auto camera = reader->camera();
  if (!camera || camera->control_socket[0] == '\0') {
    return bad_input("daemon '" + name + "' has no control socket: set control.enable = true");
  }
  return std::string(camera->control_socket);
}

Error unreachable(const std::string& path) {
  return {ErrorKind::kBadInput, "control socket " + path + ": " + std::strerror(errno) +
                                    "; is the daemon running, and may this user use it (control.mode)?"};
}

// Sends one request line, returns the answer without its end.
Result<std::string> ask(const std::string& path, std::string_view request) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof kPatience);
  const std::string line = std::string(request) + "\n";
  if (connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      send(fd, line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size())) {
    const Error error = unreachable(path);
    close(fd);
    return tl::unexpected<Error>(error);
  }
  std::string answer;
  std::array<char, 1024> buffer;
  for (ssize_t got = 0; answer.find('\n') == std::string::npos;
       answer.append(buffer.data(), static_cast<std::size_t>(got))) {
    got = recv(fd, buffer.data(), buffer.size(), 0);
    if (got <= 0) break;
  }
  close(fd);
  if (answer.empty()) return failed("control socket " + path + ": the daemon did not answer");
  return answer.substr(0, answer.find('\n'));
}

}  // namespace

int nuc_main(int argc, char** argv) {
  cxxopts::Options cli("bolo nuc", "Have a running daemon's camera correct its pixels (NUC) now.");
  std::string name;
  bool json = false;
  cli.add_options()("name", "The daemon's name", cxxopts::value(name))("json", "Print the daemon's answer",
                                                                       cxxopts::value(json));
  cli.parse_positional({"name"});
  cli.positional_help("NAME");
  cxxopts::ParseResult parsed;
  if (const auto code = parse(cli, argc, argv, parsed)) return *code;
  if (name.empty()) return report("nuc", {ErrorKind::kBadInput, "NAME is missing: bolo nuc NAME"});
  const auto path = socket_of(name);
  if (!path) return report("nuc", path.error());
  const auto answer = ask(*path, "nuc");
  if (!answer) return report("nuc", answer.error());
  if (json) std::puts(answer->c_str());
  const auto told = nlohmann::json::parse(*answer, nullptr, false);
  if (told.is_object() && told.value("ok", false)) {
    if (!json) std::puts("the camera corrects its pixels");
    return kExitDone;
  }
  return report("nuc", {ErrorKind::kFailed, told.is_object() ? told.value("error", *answer) : *answer});
}

}  // namespace bolo::tools
