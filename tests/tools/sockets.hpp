// Clients of a server's socket, and servers that replace a real one.
#pragma once

#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "src/core/unique_fd.hpp"
#include "tests/test.hpp"

namespace bolo::tools::test {

// Listens (SOCK_STREAM) or receives datagrams (SOCK_DGRAM) at this path. `flags`: such as SOCK_NONBLOCK.
inline UniqueFd bound_at(const std::string& path, int type, int flags = 0) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  UniqueFd fd(socket(AF_UNIX, type | SOCK_CLOEXEC | flags, 0));
  sockaddr_un place{AF_UNIX, {}};
  path.copy(place.sun_path, sizeof place.sun_path - 1);
  EXPECT_EQ(bind(fd.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place), 0) << std::strerror(errno);
  if (type == SOCK_STREAM) {
    EXPECT_EQ(listen(fd.get(), 64), 0);
  }
  return fd;
}

inline std::string datagrams(const UniqueFd& fd) {
  std::array<char, 65536> buffer;
  std::string text;
  for (ssize_t got = 0; (got = recv(fd.get(), buffer.data(), buffer.size(), MSG_DONTWAIT)) >= 0;) {
    text.append(buffer.data(), static_cast<std::size_t>(got)).append("\n");
  }
  return text;
}

// A socket whose receive calls time out, as a guard against hanging.
inline UniqueFd patient_socket(int family, int patience_s = 30) {
  UniqueFd fd(socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const timeval patience{patience_s, 0};
  setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  return fd;
}

inline bool connect_to(const UniqueFd& fd, const std::string& path) {
  sockaddr_un place{AF_UNIX, {}};
  path.copy(place.sun_path, sizeof place.sun_path - 1);
  return connect(fd.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0;
}
inline bool connect_to(const UniqueFd& fd, const std::string& address, std::uint16_t port) {
  sockaddr_in place{};
  place.sin_family = AF_INET;
  place.sin_port = htons(port);
  inet_pton(AF_INET, address.c_str(), &place.sin_addr);
  return connect(fd.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0;
}

inline void send_text(const UniqueFd& fd, std::string_view text) {
  EXPECT_EQ(send(fd.get(), text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
}

// Everything until the server closes the connection; "?" on timeout.
inline std::string receive_all(const UniqueFd& fd) {
  std::string all;
  std::array<char, 65536> part;
  ssize_t got = 0;
  while ((got = recv(fd.get(), part.data(), part.size(), 0)) > 0)
    all.append(part.data(), static_cast<std::size_t>(got));
  return got == 0 || errno == ECONNRESET ? all : "?";
}

}  // namespace bolo::tools::test
