#include "drivers/genicam/network.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <linux/filter.h>
#include <net/if.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <memory>
#include <system_error>
#include <thread>
#include <utility>

#include "src/core/byte_order.hpp"
#include "src/core/threads.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::genicam {
namespace {

// GigE Vision registers: who controls the camera. kPrivilege is mandatory, the others are optional.
constexpr std::uint32_t kPrivilege = 0x0A00;
constexpr std::uint32_t kPrimaryPort = 0x0A04;
constexpr std::uint32_t kPrimaryAddress = 0x0A14;

enum class Command : std::uint16_t {
  kDiscovery = 0x0002,
  kReadRegister = 0x0080,
  kWriteRegister = 0x0082,
  kReadMemory = 0x0084
};

class UdpSocket {
 public:
  int fd() const { return fd_.get(); }

  // 0, or errno.
  int connect_to(const std::string& ipv4) const {
    const sockaddr_in peer = address_of(ipv4, kGvcpPort);
    return connect(fd_.get(), reinterpret_cast<const sockaddr*>(&peer), sizeof peer) == 0 ? 0 : errno;
  }

  // False when another socket has the port.
  bool bind_to(const std::string& ipv4, std::uint16_t port) const {
    const sockaddr_in own = address_of(ipv4, port);
    return bind(fd_.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own) == 0;
  }

 private:
  UniqueFd fd_{socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)};
};

// Sends a GVCP command of 32-bit words and waits for its acknowledge, at most three times and 0.7 s in all. Returns its
// data (at least one word); nothing when the camera refuses or is silent.
std::optional<std::vector<unsigned char>> query_all(const UdpSocket& socket, Command command,
                                                    std::initializer_list<std::uint32_t> words) {
  constexpr int kTries = 3;
  constexpr std::chrono::milliseconds kWait(230);
  constexpr std::uint16_t kRequest = 1;
  constexpr std::uint32_t kKeyAndAcknowledge = 0x4201;
  std::vector<std::uint8_t> message(8 + 4 * words.size());
  store_u16(message, 0, kKeyAndAcknowledge);
  store_u16(message, 2, static_cast<std::uint32_t>(command));
  store_u16(message, 4, static_cast<std::uint32_t>(4 * words.size()));
  store_u16(message, 6, kRequest);
  for (std::size_t at = 8; const std::uint32_t word : words) store_u32(message, std::exchange(at, at + 4), word);
  for (int i = 0; i < kTries; ++i) {
    if (send(socket.fd(), message.data(), message.size(), 0) < 0 && errno != ECONNREFUSED) return std::nullopt;
    const auto until = std::chrono::steady_clock::now() + kWait;
    for (auto left = kWait; left.count() >= 0;
         left = std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now())) {
      pollfd event{socket.fd(), POLLIN, 0};
      if (poll(&event, 1, static_cast<int>(left.count())) <= 0) break;
      std::array<unsigned char, 576> answer{};
      const ssize_t bytes = recv(socket.fd(), answer.data(), answer.size(), 0);
      if (bytes < 0) break;  // nobody listens there
      if (bytes < 12 || load_u16(answer, 2) != static_cast<std::uint32_t>(command) + 1) continue;
      if (load_u16(answer, 0) != 0) return std::nullopt;
      return std::vector<unsigned char>(answer.begin() + 8, answer.begin() + bytes);
    }
  }
  return std::nullopt;
}

std::optional<std::uint32_t> query(const UdpSocket& socket, Command command,
                                   std::initializer_list<std::uint32_t> words) {
  const auto answer = query_all(socket, command, words);
  return answer ? std::optional(load_u32(*answer, 0)) : std::nullopt;
}

int mtu_of(const UdpSocket& socket, const std::string& interface) {
  ifreq request{};
  interface.copy(request.ifr_name, IFNAMSIZ - 1);
  return ioctl(socket.fd(), SIOCGIFMTU, &request) == 0 ? request.ifr_mtu : 1500;
}

std::optional<ifaddrs> find_interface(const ifaddrs* list, const in_addr& address) {
  for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) {
    if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET) continue;
    const auto* own = reinterpret_cast<const sockaddr_in*>(i->ifa_addr);
    if (own->sin_addr.s_addr == address.s_addr) return *i;
  }
  return std::nullopt;
}

}  // namespace

sockaddr_in address_of(const std::string& ipv4, std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  inet_pton(AF_INET, ipv4.c_str(), &address.sin_addr);
  return address;
}

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
  return query(socket, Command::kDiscovery, {}).has_value();
}

std::optional<std::vector<unsigned char>> read_memory(const std::string& ipv4, std::uint32_t address,
                                                      std::uint32_t bytes) {
  constexpr std::size_t kAddressBytes = 4;  // first word of the answer
  const UdpSocket socket;
  if (socket.connect_to(ipv4) != 0) return std::nullopt;
  auto answer = query_all(socket, Command::kReadMemory, {address, bytes});
  if (!answer || answer->size() < kAddressBytes + bytes || load_u32(*answer, 0) != address) return std::nullopt;
  return std::vector<unsigned char>(answer->begin() + kAddressBytes, answer->begin() + kAddressBytes + bytes);
}

bool free_from_dead_program(const std::string& ipv4, const std::string& own_address) {
  const UdpSocket living;
  if (living.connect_to(ipv4) != 0) return false;
  const auto address = query(living, Command::kReadRegister, {kPrimaryAddress});
  const auto port = query(living, Command::kReadRegister, {kPrimaryPort});
  const std::uint32_t own = ntohl(address_of(own_address, 0).sin_addr.s_addr);
  if (!address || !port || *port == 0 || *address != own) return false;
  const UdpSocket dead;
  if (!dead.bind_to(own_address, static_cast<std::uint16_t>(*port))) return false;
  return dead.connect_to(ipv4) == 0 && query(dead, Command::kWriteRegister, {kPrivilege, 0}).has_value();
}

bool filter_stream(int socket, const std::string& camera_address, std::uint16_t source_port) {
  constexpr auto kSourceAddress = static_cast<std::uint32_t>(SKF_NET_OFF + 12);  // in the IP header
  constexpr std::uint32_t kSourcePort = 0;  // a socket filter starts at the UDP header: 8 bytes
  constexpr std::uint32_t kContent = 8 + 4;
  constexpr std::uint32_t kContentBits = 0x7f;  // highest bit: extended ids
  constexpr std::uint32_t kShortest = 8 + 8;
  constexpr std::uint32_t kWhole = 0xffffffff;
  in_addr camera{};
  if (inet_pton(AF_INET, camera_address.c_str(), &camera) != 1) return false;
  const auto other_port = static_cast<std::uint8_t>(source_port == 0 ? 0 : 7);
  std::array<sock_filter, 12> steps{
      {BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kSourceAddress),
       BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ntohl(camera.s_addr), 0, 9), BPF_STMT(BPF_LD | BPF_H | BPF_ABS, kSourcePort),
       BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, source_port, 0, other_port), BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0),
       BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kShortest, 0, 5), BPF_STMT(BPF_LD | BPF_B | BPF_ABS, kContent),
       BPF_STMT(BPF_ALU | BPF_AND | BPF_K, kContentBits), BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 2, 0),
       BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, 3, 1, 0), BPF_STMT(BPF_RET | BPF_K, kWhole), BPF_STMT(BPF_RET | BPF_K, 0)}};
  const sock_fprog filter{static_cast<unsigned short>(steps.size()), steps.data()};
  return setsockopt(socket, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

Status check_resources() {
  constexpr std::size_t kForADevice = 16;
  std::size_t wanted = kForADevice;
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) == 0) {  // one per network for the camera search
    for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) ++wanted;
    freeifaddrs(list);
  }
  std::vector<UniqueFd> tried;
  while (tried.size() < wanted) {
    tried.emplace_back(eventfd(0, EFD_CLOEXEC));
    if (tried.back()) continue;
    return failed(std::string("no file descriptors are left to ask cameras with (") + std::strerror(errno) +
                  "): raise LimitNOFILE (ulimit -n), " + std::to_string(wanted) + " must be free");
  }
  try {
    std::thread([] {}).join();
  } catch (const std::system_error& e) {
    return failed(describe_exception(e));
  }
  return {};
}

int largest_socket_buffer() {
  const UdpSocket socket;
  int bytes = std::numeric_limits<int>::max() / 2;
  socklen_t length = sizeof bytes;
  if (setsockopt(socket.fd(), SOL_SOCKET, SO_RCVBUF, &bytes, length) != 0) return 0;
  if (getsockopt(socket.fd(), SOL_SOCKET, SO_RCVBUF, &bytes, &length) != 0) return 0;
  return bytes / 2;  // the kernel doubles the granted size for its bookkeeping: socket(7)
}

}  // namespace bolo::genicam
