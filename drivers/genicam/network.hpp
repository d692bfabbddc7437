// What the host's network says about the way to a camera.
#pragma once

#include <string>

#include "bolo/core/result.hpp"

namespace bolo::genicam {

struct Route {
  std::string local_address;  // of the interface that leads to the camera
  std::string interface;      // its name
  int mtu = 1500;             // bytes
  bool loopback = false;
};

// True for an IPv4 address in dotted form. Thread: any.
bool is_ipv4(const std::string& text);

// The interface through which the kernel would reach the address. kBadInput when there is none. Thread: setup.
Result<Route> route_to(const std::string& ipv4);

// Asks the address with GigE Vision's discovery command whether a camera listens there: true, or false after about
// 0.7 s. Much sooner than the library's own time-out of several seconds. Thread: setup.
bool answers_gvcp(const std::string& ipv4);

// The largest socket buffer that the kernel grants, bytes; 0 when it does not say. Thread: setup.
int largest_socket_buffer();

}  // namespace bolo::genicam
