#include "drivers/fakecam/network.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>

#include <fmt/format.h>

#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::size_t kWordBytes = 4;
constexpr std::uint32_t kPrivilegeBits = reg::kPrivilegeExclusive | reg::kPrivilegeControl;

bool is(std::uint16_t command, gvcp::Command which) { return command == static_cast<std::uint16_t>(which); }

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

// Binds the camera's own address exclusively: a second camera on it is an error.
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

// Binds a broadcast address shared with other cameras; an invalid descriptor when that fails.
UniqueFd bind_broadcast(std::uint32_t address, std::uint16_t port) {
  UniqueFd fd = udp_socket();
  if (!fd) return {};
  set_option(fd.get(), SOL_SOCKET, SO_REUSEADDR, 1);
  set_option(fd.get(), IPPROTO_IP, IP_PKTINFO, 1);
  return bind_to(fd.get(), address, port) ? std::move(fd) : UniqueFd{};
}

constexpr std::uint32_t kLimitedBroadcast = 0xffffffff;
constexpr int kHeartbeatCheckMs = 100;
constexpr int kFaultCheckMs = 2;
constexpr std::size_t kMaxPacketBytes = 65536;

// The interface that received the packet; 0 when the kernel did not report it.
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

CommandHandler::CommandHandler(RegisterMap& registers, Counters& counters, Hooks hooks)
    : registers_(registers), counters_(counters), hooks_(std::move(hooks)) {
  registers_.writable(reg::kPrivilege, [this](std::uint32_t value) { return write_privilege(value); });
}

ConstBytes CommandHandler::handle(ConstBytes packet, Peer peer, std::int64_t now_ns) {
  check_heartbeat(now_ns);
  if (packet.size() < gvcp::kHeaderBytes || packet[0] != gvcp::kKey) {  // not GVCP, or an acknowledge: ignored
    counters_.add(&FakeCameraStats::bad_commands);
    return {};
  }
  peer_ = peer;
  now_ns_ = now_ns;
  data_bytes_ = 0;
  const Header header{packet[1], load_u16(packet, 2), load_u16(packet, 6)};
  const ConstBytes data = packet.subspan(gvcp::kHeaderBytes);
  const bool whole = load_u16(packet, 4) == data.size();
  const gvcp::Status status = whole ? dispatch(header.command, data) : gvcp::Status::kInvalidHeader;
  if (may_write()) last_command_ns_ = now_ns;
  counters_.add(status == gvcp::Status::kSuccess ? &FakeCameraStats::commands : &FakeCameraStats::bad_commands);
  const bool wants_answer =
      (header.flags & gvcp::kAckRequired) != 0 && !is(header.command, gvcp::Command::kPacketResend);
  return wants_answer ? acknowledge(header, status) : ConstBytes{};
}

ConstBytes CommandHandler::handle_broadcast(ConstBytes packet, Peer peer, std::int64_t now_ns) {
  if (packet.size() < gvcp::kHeaderBytes || !is(load_u16(packet, 2), gvcp::Command::kDiscovery)) return {};
  return handle(packet, peer, now_ns);
}

gvcp::Status CommandHandler::dispatch(std::uint16_t command, ConstBytes data) {
  static constexpr std::array kKnown{std::pair{gvcp::Command::kDiscovery, &CommandHandler::discover},
                                     std::pair{gvcp::Command::kReadRegister, &CommandHandler::read_registers},
                                     std::pair{gvcp::Command::kWriteRegister, &CommandHandler::write_registers},
                                     std::pair{gvcp::Command::kReadMemory, &CommandHandler::read_memory},
                                     std::pair{gvcp::Command::kWriteMemory, &CommandHandler::write_memory},
                                     std::pair{gvcp::Command::kPacketResend, &CommandHandler::resend}};
  for (const auto& [known, act] : kKnown) {
    if (is(command, known)) return (this->*act)(data);
  }
  return gvcp::Status::kNotImplemented;
}

gvcp::Status CommandHandler::discover(ConstBytes) {
  data_bytes_ = gvcp::kDiscoveryBytes;
  return registers_.read(0, data().first(gvcp::kDiscoveryBytes));
}

// Addresses in, values out; after a failed read the answer ends before the failed register.
gvcp::Status CommandHandler::read_registers(ConstBytes addresses) {
  if (addresses.empty() || addresses.size() % kWordBytes != 0 || addresses.size() > gvcp::kMaxDataBytes) {
    return gvcp::Status::kInvalidParameter;
  }
  if (!may_read()) return gvcp::Status::kAccessDenied;
  for (std::size_t at = 0; at < addresses.size(); at += kWordBytes) {
    const auto status = registers_.read(load_u32(addresses, at), data().subspan(at, kWordBytes));
    if (status != gvcp::Status::kSuccess) return status;
    data_bytes_ += kWordBytes;
  }
  return gvcp::Status::kSuccess;
}

// Pairs of address and value; the answer holds the number of pairs written.
gvcp::Status CommandHandler::write_registers(ConstBytes pairs) {
  constexpr std::size_t kPairBytes = 2 * kWordBytes;
  if (pairs.empty() || pairs.size() % kPairBytes != 0) return gvcp::Status::kInvalidParameter;
  data_bytes_ = kWordBytes;
  store_u32(data(), 0, 0);
  for (std::size_t at = 0; at < pairs.size(); at += kPairBytes) {
    const std::uint32_t address = load_u32(pairs, at);
    if (address != reg::kPrivilege && !may_write()) return gvcp::Status::kAccessDenied;
    const auto status = registers_.write(address, pairs.subspan(at + kWordBytes, kWordBytes));
    if (status != gvcp::Status::kSuccess) return status;
    store_u16(data(), 2, static_cast<std::uint16_t>(at / kPairBytes + 1));
  }
  return gvcp::Status::kSuccess;
}

gvcp::Status CommandHandler::read_memory(ConstBytes request) {
  if (request.size() != 2 * kWordBytes) return gvcp::Status::kInvalidParameter;
  const std::uint32_t address = load_u32(request, 0);
  const std::size_t count = load_u16(request, 6);
  if (count == 0 || count > gvcp::kMaxMemoryBytes) return gvcp::Status::kInvalidParameter;
  if (!may_read()) return gvcp::Status::kAccessDenied;
  const auto status = registers_.read(address, data().subspan(kWordBytes, count));
  if (status != gvcp::Status::kSuccess) return status;
  store_u32(data(), 0, address);
  data_bytes_ = kWordBytes + count;
  return status;
}

gvcp::Status CommandHandler::write_memory(ConstBytes request) {
  if (request.size() <= kWordBytes) return gvcp::Status::kInvalidParameter;
  if (!may_write()) return gvcp::Status::kAccessDenied;
  const ConstBytes values = request.subspan(kWordBytes);
  const auto status = registers_.write(load_u32(request, 0), values);
  data_bytes_ = kWordBytes;
  store_u32(data(), 0, status == gvcp::Status::kSuccess ? static_cast<std::uint32_t>(values.size()) : 0);
  return status;
}

// Not acknowledged: the packets are the answer. Any peer may ask, because receivers ask from their stream socket.
gvcp::Status CommandHandler::resend(ConstBytes request) {
  constexpr std::size_t kRequestBytes = 12;
  if (request.size() < kRequestBytes) return gvcp::Status::kInvalidParameter;
  const ResendRequest wanted{load_u16(request, 2), load_u32(request, 4) & 0xffffffU, load_u32(request, 8) & 0xffffffU};
  if (wanted.last_packet < wanted.first_packet) return gvcp::Status::kInvalidParameter;
  hooks_.on_resend(wanted);
  return gvcp::Status::kSuccess;
}

WriteOutcome CommandHandler::write_privilege(std::uint32_t value) {
  if (controlled_ && peer_ != controller_) return refuse(gvcp::Status::kAccessDenied);
  const std::uint32_t wanted = value & kPrivilegeBits;
  if (wanted == 0) {
    drop_client();
    return 0U;
  }
  if (!controlled_) counters_.add(&FakeCameraStats::clients);
  controlled_ = true;
  controller_ = peer_;
  last_command_ns_ = now_ns_;
  counters_.change([](FakeCameraStats& stats) { stats.controlled = true; });
  registers_.set(reg::kPrimaryAddress, peer_.address);
  registers_.set(reg::kPrimaryPort, peer_.port);
  return wanted;
}

void CommandHandler::lose_control() {
  controlled_ = false;
  controller_ = {};
  counters_.change([](FakeCameraStats& stats) { stats.controlled = false; });
  registers_.set(reg::kPrivilege, 0);
  registers_.set(reg::kPrimaryAddress, 0);
  registers_.set(reg::kPrimaryPort, 0);
  hooks_.on_control_lost();
}

void CommandHandler::drop_client() {
  if (controlled_) lose_control();
}

void CommandHandler::check_heartbeat(std::int64_t now_ns) {
  if (!controlled_ || (registers_.get(reg::kGvcpConfig) & reg::kHeartbeatOff) != 0) return;
  if (now_ns - last_command_ns_ <= registers_.get(reg::kHeartbeatTimeout) * kNsPerMs) return;
  counters_.add(&FakeCameraStats::heartbeat_losses);
  lose_control();
}

bool CommandHandler::may_read() const {
  return !controlled_ || peer_ == controller_ || (registers_.get(reg::kPrivilege) & reg::kPrivilegeExclusive) == 0;
}

ConstBytes CommandHandler::acknowledge(const Header& header, gvcp::Status status) {
  const Bytes head(answer_);
  store_u16(head, 0, static_cast<std::uint16_t>(status));
  store_u16(head, 2, gvcp::ack_of(header.command));
  store_u16(head, 4, static_cast<std::uint16_t>(data_bytes_));
  store_u16(head, 6, header.id);
  return ConstBytes(answer_).first(gvcp::kHeaderBytes + data_bytes_);
}

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
    const bool frozen = commands == ControlFaults::Commands::kFrozen;  // the heartbeat clock stops, too
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
  const Peer peer{ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)};
  const ConstBytes answer =
      broadcast ? handler.handle_broadcast(data, peer, monotonic_ns()) : handler.handle(data, peer, monotonic_ns());
  if (answer.empty()) return;
  // From the camera's own address, also for a broadcast.
  sendto(socket_.get(), answer.data(), answer.size(), 0, reinterpret_cast<const sockaddr*>(&from), sizeof(from));
}

}  // namespace bolo::fakecam
