// Route to a camera, GVCP probes and socket filters.
#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::genicam {

inline constexpr std::uint16_t kGvcpPort = 3956;

struct Route {
  std::string local_address;  // of the interface that leads to the camera
  std::string interface;      // its name
  int mtu = 1500;             // bytes
  bool loopback = false;
};

// Of an IPv4 address in dotted form. Thread: any.
sockaddr_in address_of(const std::string& ipv4, std::uint16_t port);
// True for an IPv4 address in dotted form. Thread: any.
bool is_ipv4(const std::string& text);

// The interface through which the kernel would reach the address. kBadInput when there is none. Thread: setup.
Result<Route> route_to(const std::string& ipv4);

// Asks the address with GigE Vision's discovery command whether a camera listens there: true, or false after about
// 0.7 s. Much sooner than the library's own time-out of several seconds. Thread: setup.
bool answers_gvcp(const std::string& ipv4);

// Reads a camera's memory: bytes from the address on, both multiples of 4, 512 at most. Nothing when the camera refuses
// or is silent for 0.7 s. Thread: setup.
std::optional<std::vector<unsigned char>> read_memory(const std::string& ipv4, std::uint32_t address,
                                                      std::uint32_t bytes);

// Takes control of the camera away from a program on this computer that died: a camera grants it until no heartbeat
// came for some 3 s, and has the holder's address and port in registers, if at all. Only when no process has that port
// any more, from which the camera is then sent a release of control. True when it was. Thread: setup.
bool free_from_dead_program(const std::string& ipv4, const std::string& own_address);

// Has the kernel drop packets to a stream's socket from another address than the camera's, or from another port when
// source_port is not 0, and those that are no leader, payload or trailer. Keeps strangers out of the socket's buffer;
// forged sender addresses are left to gvsp::Assembler. False when the kernel refuses. Thread: setup.
bool filter_stream(int socket, const std::string& camera_address, std::uint16_t source_port);

// Checks that the system has the descriptors and the thread that Aravis needs to look for cameras and to open one:
// refused a socket it goes on with none, refused a thread GLib aborts. Errors: kFailed. Thread: setup, or the
// connection manager's.
Status check_resources();

// The largest socket buffer that the kernel grants, bytes; 0 when unknown. Thread: setup.
int largest_socket_buffer();

}  // namespace bolo::genicam
