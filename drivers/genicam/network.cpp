#include "drivers/genicam/network.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>
#include <optional>

namespace bolo::genicam {
namespace {

constexpr std::uint16_t kGvcpPort = 3956;

class UdpSocket {
 public:
  UdpSocket() : fd_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  ~UdpSocket() {
    if (fd_ >= 0) close(fd_);
  }
  UdpSocket(const UdpSocket&) = delete;
  UdpSocket& operator=(const UdpSocket&) = delete;

  int fd() const { return fd_; }

  // 0, or errno.
  int connect_to(const std::string& ipv4) const {
    sockaddr_in peer{};
    peer.sin_family = AF_INET;
    peer.sin_port = htons(kGvcpPort);
    inet_pton(AF_INET, ipv4.c_str(), &peer.sin_addr);
    return connect(fd_, reinterpret_cast<const sockaddr*>(&peer), sizeof peer) == 0 ? 0 : errno;
  }

 private:
  int fd_;
};

int mtu_of(const UdpSocket& socket, const std::string& interface) {
  ifreq request{};
  interface.copy(request.ifr_name, IFNAMSIZ - 1);
  return ioctl(socket.fd(), SIOCGIFMTU, &request) == 0 ? request.ifr_mtu : 1500;
}

// The interface that has the address.
std::optional<ifaddrs> find_interface(const ifaddrs* list, const in_addr& address) {
  for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) {
    if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET) continue;
    const auto* own = reinterpret_cast<const sockaddr_in*>(i->ifa_addr);
    if (own->sin_addr.s_addr == address.s_addr) return *i;
  }
  return std::nullopt;
}

}  // namespace

bool is_ipv4(const std::string& text) {
  in_addr address{};
  return inet_pton(AF_INET, text.c_str(), &address) == 1;
}

Result<Route> route_to(const std::string& ipv4) {
  const UdpSocket socket;
  if (const int code = socket.connect_to(ipv4); code != 0) {
    return bad_input("no route to camera " + ipv4 + " (" + std::strerror(code) +
                     "): give this computer an address in the camera's subnet and check that the link is up");
  }
  sockaddr_in local{};
  socklen_t size = sizeof local;
  if (getsockname(socket.fd(), reinterpret_cast<sockaddr*>(&local), &size) != 0) {
    return failed("camera " + ipv4 + ": the kernel does not name its own address (" + std::strerror(errno) + ")");
  }
  Route route;
  std::array<char, INET_ADDRSTRLEN> text{};
  inet_ntop(AF_INET, &local.sin_addr, text.data(), text.size());
  route.local_address = text.data();

  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return route;
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
  if (const auto own = find_interface(list, local.sin_addr)) {
    route.interface = own->ifa_name;
    route.loopback = (own->ifa_flags & IFF_LOOPBACK) != 0;
    route.mtu = mtu_of(socket, route.interface);
  }
  return route;
}

bool answers_gvcp(const std::string& ipv4) {
  const UdpSocket socket;
  if (socket.connect_to(ipv4) != 0) return false;
  // Key 0x42, flag "acknowledge", DISCOVERY_CMD, no payload, request 1; the answer is DISCOVERY_ACK.
  constexpr std::array<unsigned char, 8> kDiscovery{0x42, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01};
  constexpr int kTries = 3;
  constexpr int kWaitMs = 230;
  for (int i = 0; i < kTries; ++i) {
    if (send(socket.fd(), kDiscovery.data(), kDiscovery.size(), 0) < 0 && errno != ECONNREFUSED) return false;
    pollfd event{socket.fd(), POLLIN, 0};
    if (poll(&event, 1, kWaitMs) <= 0) continue;
    std::array<unsigned char, 512> answer{};
    const ssize_t bytes = recv(socket.fd(), answer.data(), answer.size(), 0);
    if (bytes >= 8 && answer[2] == 0x00 && answer[3] == 0x03) return true;
  }
  return false;
}

int largest_socket_buffer() {
  std::ifstream file("/proc/sys/net/core/rmem_max");
  int bytes = 0;
  return file >> bytes ? bytes : 0;
}

}  // namespace bolo::genicam
