#include "drivers/fakecam/network.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>

#include <fmt/format.h>

#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

constexpr int kSendBufferBytes = 4 << 20;

std::uint32_t host_address(const sockaddr* address) {
  sockaddr_in in{};
  std::memcpy(&in, address, sizeof(in));
  return ntohl(in.sin_addr.s_addr);
}

UniqueFd udp_socket() { return UniqueFd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)); }

void set_option(int fd, int level, int option, int value) { setsockopt(fd, level, option, &value, sizeof(value)); }

bool bind_to(int fd, std::uint32_t address, std::uint16_t port) {
  const sockaddr_in where = socket_address(address, port);
  return bind(fd, reinterpret_cast<const sockaddr*>(&where), sizeof(where)) == 0;
}

constexpr std::uint32_t kLimitedBroadcast = 0xffffffff;
constexpr int kHeartbeatCheckMs = 100;
constexpr int kFaultCheckMs = 2;
constexpr std::size_t kMaxPacketBytes = 65536;

// The interface that a packet came in on; 0 when the kernel didn't say.
unsigned arrival_interface(msghdr& message) {
  for (cmsghdr* at = CMSG_FIRSTHDR(&message); at != nullptr; at = CMSG_NXTHDR(&message, at)) {
    if (at->cmsg_level != IPPROTO_IP || at->cmsg_type != IP_PKTINFO) continue;
    in_pktinfo info{};
    std::memcpy(&info, CMSG_DATA(at), sizeof(info));
    return static_cast<unsigned>(info.ipi_ifindex);
  }
  return 0;
}

}  // namespace

Result<LocalAddress> find_local_address(const std::string& text) {
  in_addr parsed{};
  if (inet_pton(AF_INET, text.c_str(), &parsed) != 1) {
    return bad_input("'" + text + "' is not an IPv4 address; give one of this host's, for example 127.0.0.1");
  }
  const std::uint32_t wanted = ntohl(parsed.s_addr);
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return failed(std::string("can't list the network interfaces: ") + std::strerror(errno));
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> guard(list, &freeifaddrs);
  for (const ifaddrs* at = list; at != nullptr; at = at->ifa_next) {
    if (at->ifa_addr == nullptr || at->ifa_netmask == nullptr || at->ifa_addr->sa_family != AF_INET) continue;
    const std::uint32_t address = host_address(at->ifa_addr);
    const std::uint32_t netmask = host_address(at->ifa_netmask);
    const bool loopback = (at->ifa_flags & IFF_LOOPBACK) != 0;
    if (address != wanted && !(loopback && ((address ^ wanted) & netmask) == 0)) continue;
    return LocalAddress{wanted, netmask, if_nametoindex(at->ifa_name)};
  }
  return bad_input("no network interface of this host has the address " + text + "; 'ip addr' lists them");
}

Result<UniqueFd> bind_exclusive(std::uint32_t address, std::uint16_t port) {
  UniqueFd fd = udp_socket();
  if (!fd) return failed(std::string("can't open a UDP socket: ") + std::strerror(errno));
  if (bind_to(fd.get(), address, port)) return fd;
  const std::string where = dotted(address) + ":" + std::to_string(port);
  if (errno == EADDRINUSE) {
    return bad_input("another camera, perhaps a stale one, already serves " + where +
                     "; end it, or give this one another address");
  }
  return bad_input("can't bind " + where + ": " + std::strerror(errno));
}

UniqueFd bind_broadcast(std::uint32_t address, std::uint16_t port) {
  UniqueFd fd = udp_socket();
  if (!fd) return {};
  set_option(fd.get(), SOL_SOCKET, SO_REUSEADDR, 1);
  set_option(fd.get(), IPPROTO_IP, IP_PKTINFO, 1);
  return bind_to(fd.get(), address, port) ? std::move(fd) : UniqueFd{};
}

Result<UniqueFd> open_stream_socket(std::uint32_t address) {
  UniqueFd fd = udp_socket();
  if (!fd || !bind_to(fd.get(), address, 0)) {
    return failed("can't open the stream's socket on " + dotted(address) + ": " + std::strerror(errno));
  }
  set_option(fd.get(), SOL_SOCKET, SO_SNDBUF, kSendBufferBytes);
  return fd;
}

std::uint16_t bound_port(int socket) {
  sockaddr_in where{};
  socklen_t size = sizeof(where);
  return getsockname(socket, reinterpret_cast<sockaddr*>(&where), &size) == 0 ? ntohs(where.sin_port)
                                                                              : std::uint16_t{0};
}

void set_do_not_fragment(int socket, bool on) noexcept {
  set_option(socket, IPPROTO_IP, IP_MTU_DISCOVER, on ? IP_PMTUDISC_DO : IP_PMTUDISC_DONT);
}

sockaddr_in socket_address(std::uint32_t address, std::uint16_t port) {
  sockaddr_in where{};
  where.sin_family = AF_INET;
  where.sin_port = htons(port);
  where.sin_addr.s_addr = htonl(address);
  return where;
}

Peer peer_of(const sockaddr_in& address) { return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)}; }

std::string dotted(std::uint32_t address) {
  return fmt::format("{}.{}.{}.{}", address >> 24U, address >> 16U & 0xffU, address >> 8U & 0xffU, address & 0xffU);
}

Result<ControlServer> ControlServer::bind(const LocalAddress& local, std::uint16_t port) {
  ControlServer server;
  server.local_ = local;
  ASSIGN_OR_RETURN(server.socket_, bind_exclusive(local.address, port));
  for (const std::uint32_t address : {kLimitedBroadcast, local.address | ~local.netmask}) {
    if (auto fd = bind_broadcast(address, port)) server.broadcast_sockets_.push_back(std::move(fd));
  }
  return server;
}

void ControlServer::run(CommandHandler& handler, ControlFaults& faults, int stop_event) {
  std::vector<pollfd> waits{{stop_event, POLLIN, 0}, {socket_.get(), POLLIN, 0}};
  for (const auto& fd : broadcast_sockets_) waits.push_back({fd.get(), POLLIN, 0});
  const int poll_ms = faults.any() ? kFaultCheckMs : kHeartbeatCheckMs;
  auto commands = ControlFaults::Commands::kAnswered;
  while (true) {
    const bool frozen = commands == ControlFaults::Commands::kFrozen;  // not even the heartbeat's clock runs
    const int ready = poll(waits.data(), frozen ? 1 : waits.size(), poll_ms);
    if (ready > 0 && waits[0].revents != 0) return;
    commands = faults.update(monotonic_ns());
    if (frozen || commands == ControlFaults::Commands::kFrozen) continue;
    handler.check_heartbeat(monotonic_ns());
    for (std::size_t i = 1; i < waits.size() && ready > 0; ++i) {
      if (waits[i].revents == 0) continue;
      if (commands == ControlFaults::Commands::kDropped) {
        discard(waits[i].fd);
      } else {
        receive(waits[i].fd, i > 1, handler);
      }
    }
  }
}

void ControlServer::discard(int socket) noexcept {
  std::uint8_t byte = 0;
  recv(socket, &byte, sizeof(byte), MSG_DONTWAIT);
}

void ControlServer::close() noexcept {
  socket_ = UniqueFd();
  broadcast_sockets_.clear();
}

void ControlServer::receive(int socket, bool broadcast, CommandHandler& handler) {
  static thread_local std::array<std::uint8_t, kMaxPacketBytes> packet;
  alignas(cmsghdr) std::array<std::uint8_t, CMSG_SPACE(sizeof(in_pktinfo))> control{};
  sockaddr_in from{};
  iovec part{packet.data(), packet.size()};
  msghdr message{};
  message.msg_name = &from;
  message.msg_namelen = sizeof(from);
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t bytes = recvmsg(socket, &message, MSG_DONTWAIT);
  if (bytes < 0) return;
  if (broadcast && arrival_interface(message) != local_.interface_index) return;  // another camera's network
  const auto data = ConstBytes(packet).first(static_cast<std::size_t>(bytes));
  const Peer peer = peer_of(from);
  const ConstBytes answer =
      broadcast ? handler.handle_broadcast(data, peer, monotonic_ns()) : handler.handle(data, peer, monotonic_ns());
  if (answer.empty()) return;
  // From the camera's own address, also when a broadcast asked.
  sendto(socket_.get(), answer.data(), answer.size(), 0, reinterpret_cast<const sockaddr*>(&from), sizeof(from));
}

}  // namespace bolo::fakecam
