#include "drivers/genicam/network.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <vector>

#include "src/core/unique_fd.hpp"

namespace bolo::genicam::network_test {
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

UniqueFd socket_at(const char* ipv4, sockaddr_in& address) {
  UniqueFd fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  address = {};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, ipv4, &address.sin_addr);
  socklen_t size = sizeof address;
  if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0) return {};
  getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &size);
  return fd;
}

bool passes(const UniqueFd& from, const UniqueFd& to, const sockaddr_in& to_address, std::size_t length, int content) {
  std::vector<std::uint8_t> bytes(length, 0x11);
  if (length > 4) bytes[4] = static_cast<std::uint8_t>(content);
  sendto(from.get(), bytes.data(), length, 0, reinterpret_cast<const sockaddr*>(&to_address), sizeof to_address);
  std::array<std::uint8_t, 2000> got{};
  return recv(to.get(), got.data(), got.size(), MSG_DONTWAIT) == static_cast<ssize_t>(length);
}

TEST(NetworkTest, LetsOnlyTheCamerasStreamIn) {
  sockaddr_in own{};
  sockaddr_in camera_at{};
  sockaddr_in other{};
  const UniqueFd stream = socket_at("127.0.0.1", own);
  const UniqueFd camera = socket_at("127.0.61.2", camera_at);
  const UniqueFd same_address = socket_at("127.0.61.2", other);
  const UniqueFd stranger = socket_at("127.0.61.3", other);
  ASSERT_TRUE(stream && camera && same_address && stranger);
  ASSERT_TRUE(filter_stream(stream.get(), "127.0.61.2", 0));
  EXPECT_FALSE(passes(stranger, stream, own, 100, 3));
  EXPECT_TRUE(passes(same_address, stream, own, 100, 3));
  for (const int content : {1, 2, 3, 0x81, 0x82, 0x83}) {
    EXPECT_TRUE(passes(camera, stream, own, 1472, content));
    EXPECT_TRUE(passes(camera, stream, own, 8, content));
    EXPECT_FALSE(passes(camera, stream, own, 7, content));
  }
  for (const int content : {0, 4, 5, 7, 8, 0x7f, 0x80, 0x85, 0xff}) {
    EXPECT_FALSE(passes(camera, stream, own, 100, content)) << content;
  }
  ASSERT_TRUE(filter_stream(stream.get(), "127.0.61.2", ntohs(camera_at.sin_port)));
  EXPECT_FALSE(passes(same_address, stream, own, 100, 3));
  EXPECT_TRUE(passes(camera, stream, own, 100, 3));
}

TEST(NetworkTest, ReadsTheKernelsLimit) { EXPECT_GT(largest_socket_buffer(), 0); }

}  // namespace
}  // namespace bolo::genicam::network_test
