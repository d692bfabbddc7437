#include "drivers/genicam/network.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <vector>

#include "src/core/unique_fd.hpp"

namespace bolo::genicam {
namespace {

TEST(NetworkTest, KnowsAnIpv4AddressFromADeviceId) {
  EXPECT_TRUE(is_ipv4("192.168.0.7"));
  EXPECT_FALSE(is_ipv4(""));
  EXPECT_FALSE(is_ipv4("FLIR-12345"));
  EXPECT_FALSE(is_ipv4("192.168.0"));
  EXPECT_FALSE(is_ipv4("192.168.0.256"));
}

TEST(NetworkTest, FindsTheLoopback) {
  const auto route = route_to("127.0.0.1");
  ASSERT_TRUE(route) << route.error().message;
  EXPECT_EQ(route->local_address, "127.0.0.1");
  EXPECT_TRUE(route->loopback);
  EXPECT_EQ(route->interface.substr(0, 2), "lo");
  EXPECT_GT(route->mtu, 1500);
}

TEST(NetworkTest, NothingAnswersWhereNoCameraListens) { EXPECT_FALSE(answers_gvcp("127.93.81.7")); }

// Bytes of a GVSP header that begin a datagram of this length; the fifth has the highest bit where ids are extended.
std::vector<std::uint8_t> datagram(std::size_t length, bool extended) {
  std::vector<std::uint8_t> bytes(length, 0x11);
  if (extended && length > 4) bytes[4] |= 0x80;
  return bytes;
}

TEST(NetworkTest, DropsDatagramsThatAreShorterThanTheirHeader) {
  const UniqueFd fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  ASSERT_EQ(bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size), 0);
  ASSERT_EQ(getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &size), 0);
  ASSERT_TRUE(drop_short_packets(ntohs(address.sin_port)));
  struct Case {
    std::size_t length;
    bool extended;
    bool arrives;
  };
  for (const Case& c : {Case{0, false, false}, Case{1, false, false}, Case{7, false, false}, Case{8, false, true},
                        Case{19, false, true}, Case{8, true, false}, Case{19, true, false}, Case{20, true, true},
                        Case{1480, false, true}, Case{1480, true, true}}) {
    const auto bytes = datagram(c.length, c.extended);
    const auto length = static_cast<ssize_t>(c.length);
    ASSERT_EQ(
        sendto(fd.get(), bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&address), sizeof address),
        length);
    std::array<std::uint8_t, 2000> got{};
    EXPECT_EQ(recv(fd.get(), got.data(), got.size(), MSG_DONTWAIT), c.arrives ? length : -1)
        << c.length << (c.extended ? ", extended" : "");
  }
}

TEST(NetworkTest, FindsNoSocketThatIsNotThere) { EXPECT_FALSE(drop_short_packets(1)); }

TEST(NetworkTest, ReadsTheKernelsLimit) { EXPECT_GT(largest_socket_buffer(), 0); }

}  // namespace
}  // namespace bolo::genicam
