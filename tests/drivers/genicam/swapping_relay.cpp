#include "tests/drivers/genicam/swapping_relay.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/genicam/network.hpp"

namespace bolo::genicam::test {
namespace {

using Packet = std::array<unsigned char, 2048>;

// READMEM_ACK and WRITEMEM_CMD carry an address after the header of 8 bytes, then the data.
bool swap_register(Packet& packet, ssize_t bytes, unsigned char command) {
  if (bytes != 16 || packet[2] != 0x00 || packet[3] != command) return false;
  std::reverse(packet.begin() + 12, packet.begin() + 16);
  return true;
}

}  // namespace

SwappingRelay::SwappingRelay(const std::string& own, const std::string& camera)
    : front_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)), back_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  const sockaddr_in front = address_of(own, kGvcpPort);
  const sockaddr_in back = address_of(camera, kGvcpPort);
  EXPECT_EQ(bind(front_, reinterpret_cast<const sockaddr*>(&front), sizeof front), 0);
  EXPECT_EQ(connect(back_, reinterpret_cast<const sockaddr*>(&back), sizeof back), 0);
  thread_ = std::thread([this] { run(); });
}

SwappingRelay::~SwappingRelay() {
  end_.store(true);
  thread_.join();
  close(front_);
  close(back_);
}

void SwappingRelay::run() {
  constexpr unsigned char kReadMemoryAck = 0x85;
  constexpr unsigned char kWriteMemory = 0x86;
  sockaddr_in program{};
  Packet packet{};
  while (!end_.load()) {
    std::array<pollfd, 2> events{{{front_, POLLIN, 0}, {back_, POLLIN, 0}}};
    if (poll(events.data(), events.size(), 20) <= 0) continue;
    if ((events[0].revents & POLLIN) != 0) {
      socklen_t size = sizeof program;
      const ssize_t bytes =
          recvfrom(front_, packet.data(), packet.size(), 0, reinterpret_cast<sockaddr*>(&program), &size);
      if (swap_register(packet, bytes, kWriteMemory)) swapped_.fetch_add(1);
      if (bytes > 0) {
        EXPECT_EQ(send(back_, packet.data(), static_cast<std::size_t>(bytes), 0), bytes);
      }
    }
    if ((events[1].revents & POLLIN) != 0) {
      const ssize_t bytes = recv(back_, packet.data(), packet.size(), 0);
      if (swap_register(packet, bytes, kReadMemoryAck)) swapped_.fetch_add(1);
      if (bytes > 0) {
        EXPECT_EQ(sendto(front_, packet.data(), static_cast<std::size_t>(bytes), 0,
                         reinterpret_cast<const sockaddr*>(&program), sizeof program),
                  bytes);
      }
    }
  }
}

}  // namespace bolo::genicam::test
