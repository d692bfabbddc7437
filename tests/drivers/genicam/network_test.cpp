#include "drivers/genicam/network.hpp"

#include <gtest/gtest.h>

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

TEST(NetworkTest, ReadsTheKernelsLimit) { EXPECT_GT(largest_socket_buffer(), 0); }

}  // namespace
}  // namespace bolo::genicam
