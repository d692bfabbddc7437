// Numeric IP addresses, and sockets that listen on them.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cstdint>
#include <optional>
#include <string>

#include "src/core/unique_fd.hpp"

namespace bolo {

struct IpAddress {
  sockaddr_storage place{};
  socklen_t bytes = 0;  // of `place`
  bool loopback = false;
};

// Parses "127.0.0.1" or "::1", with a port; nothing for any other text. Thread: any.
inline std::optional<IpAddress> ip_address(const std::string& text, std::uint16_t port = 0) {
  IpAddress address;
  auto& v4 = reinterpret_cast<sockaddr_in&>(address.place);
  auto& v6 = reinterpret_cast<sockaddr_in6&>(address.place);
  if (inet_pton(AF_INET, text.c_str(), &v4.sin_addr) == 1) {
    v4.sin_family = AF_INET;
    v4.sin_port = htons(port);
    address.bytes = sizeof v4;
    address.loopback = ntohl(v4.sin_addr.s_addr) >> 24U == 127;
    return address;
  }
  if (inet_pton(AF_INET6, text.c_str(), &v6.sin6_addr) != 1) return std::nullopt;
  v6.sin6_family = AF_INET6;
  v6.sin6_port = htons(port);
  address.bytes = sizeof v6;
  address.loopback = IN6_IS_ADDR_LOOPBACK(&v6.sin6_addr) != 0;
  return address;
}

// A non-blocking listening TCP socket; on failure none, with errno set. `only_v6`: no IPv4 clients. Thread: setup.
inline UniqueFd listen_on(const IpAddress& address, int backlog, bool only_v6) {
  UniqueFd fd(socket(address.place.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int on = 1;
  if (fd) setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);  // after a program that just ended
  if (fd && only_v6) setsockopt(fd.get(), IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on);
  const bool listens = fd && bind(fd.get(), reinterpret_cast<const sockaddr*>(&address.place), address.bytes) == 0 &&
                       listen(fd.get(), backlog) == 0;
  return listens ? std::move(fd) : UniqueFd();
}

}  // namespace bolo
