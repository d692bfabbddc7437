#include "tools/bolod/metrics_server.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

#include <prometheus/text_serializer.h>

namespace bolo::daemon {
namespace {

struct Listen {
  std::string host;
  int port = 0;
};

// "127.0.0.1:9464", "[::1]:9464"
std::optional<Listen> parse(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) return std::nullopt;
  Listen listen{text.substr(0, colon)};
  const char* const end = text.data() + text.size();
  const auto [read, error] = std::from_chars(text.data() + colon + 1, end, listen.port);
  constexpr int kMostPorts = 65535;
  if (error != std::errc() || read != end || listen.port < 1 || listen.port > kMostPorts) return std::nullopt;
  return listen;
}

struct Address {
  bool valid = false;
  bool loopback = false;
};

Address classify(const std::string& host) {
  constexpr std::uint32_t kLoopbackNet = 127;
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return {true, ntohl(v4.s_addr) >> 24 == kLoopbackNet};
  if (host.size() < 2 || host.front() != '[' || host.back() != ']') return {};
  in6_addr v6{};
  if (inet_pton(AF_INET6, host.substr(1, host.size() - 2).c_str(), &v6) != 1) return {};
  return {true, IN6_IS_ADDR_LOOPBACK(&v6) != 0};
}

constexpr RequestServer::Limits kLimits{.clients = 16, .patience_ms = 2000, .longest_request = 8192};
constexpr int kBacklog = 64;

// Of an address that check_listen() let pass.
Result<UniqueFd> listen_at(const Listen& listen) {
  sockaddr_storage place{};
  auto& v4 = reinterpret_cast<sockaddr_in&>(place);
  auto& v6 = reinterpret_cast<sockaddr_in6&>(place);
  const bool is_v6 = listen.host.starts_with('[');
  place.ss_family = is_v6 ? AF_INET6 : AF_INET;
  if (is_v6) {
    inet_pton(AF_INET6, listen.host.substr(1, listen.host.size() - 2).c_str(), &v6.sin6_addr);
    v6.sin6_port = htons(static_cast<std::uint16_t>(listen.port));
  } else {
    inet_pton(AF_INET, listen.host.c_str(), &v4.sin_addr);
    v4.sin_port = htons(static_cast<std::uint16_t>(listen.port));
  }
  const socklen_t bytes = is_v6 ? sizeof v6 : sizeof v4;
  UniqueFd fd(socket(place.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int on = 1;
  setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);  // after a daemon that has just ended
  if (fd && bind(fd.get(), reinterpret_cast<const sockaddr*>(&place), bytes) == 0 &&
      ::listen(fd.get(), kBacklog) == 0) {
    return fd;
  }
  const std::string port = std::to_string(listen.port);
  return failed("metrics.listen: cannot listen at " + listen.host + ":" + port + " (" + std::strerror(errno) +
                "); who has it: ss -ltnp 'sport = :" + port + "'; end that, or set metrics.listen to a free port");
}

std::string http_answer(const std::string& status, const std::string& body) {
  return "HTTP/1.1 " + status + "\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: " +
         std::to_string(body.size()) + "\r\nConnection: close\r\n\r\n" + body;
}

// Nothing: the headers have not ended yet.
std::optional<std::string> answer_to(std::string_view received, const MetricsServer::Collect& collect) {
  if (received.find("\r\n\r\n") == std::string_view::npos) return std::nullopt;
  if (!received.starts_with("GET ")) return http_answer("405 Method Not Allowed", "only GET is understood\n");
  const std::string_view path = received.substr(4, received.find_first_of(" ?\r", 4) - 4);
  if (path != "/metrics") return http_answer("404 Not Found", "what is here is /metrics\n");
  return http_answer("200 OK", prometheus::TextSerializer().Serialize(collect()));
}

}  // namespace

Status check_listen(const MetricsOptions& options) {
  const auto listen = parse(options.listen);
  const Address address = listen ? classify(listen->host) : Address{};
  if (!address.valid) {
    return bad_input("metrics.listen = \"" + options.listen + "\" is no ADDRESS:PORT such as 127.0.0.1:9464");
  }
  if (address.loopback || options.allow_remote) return {};
  return bad_input("metrics.listen = \"" + options.listen +
                   "\" is within other computers' reach: use 127.0.0.1, or set metrics.allow_remote = true");
}

Result<std::unique_ptr<MetricsServer>> MetricsServer::start(const MetricsOptions& options, Collect collect) {
  if (const Status good = check_listen(options); !good) return tl::unexpected<Error>(good.error());
  Result<UniqueFd> listener = listen_at(*parse(options.listen));
  if (!listener) return tl::unexpected<Error>(listener.error());
  try {
    return std::unique_ptr<MetricsServer>(new MetricsServer(std::move(*listener), std::move(collect)));
  } catch (const std::system_error& e) {
    return failed(std::string("metrics: no thread can be started: ") + e.what());
  }
}

MetricsServer::MetricsServer(UniqueFd listener, Collect collect)
    : server_(std::move(listener), kLimits,
              [collect = std::move(collect)](std::string_view received) { return answer_to(received, collect); }) {}

}  // namespace bolo::daemon
