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
  std::string local_address;  // of the interface towards the camera
  std::string interface;      // its name
  int mtu = 1500;             // bytes
  bool loopback = false;
};

// From a dotted IPv4 address. Thread: any.
sockaddr_in address_of(const std::string& ipv4, std::uint16_t port);
// True for a dotted IPv4 address. Thread: any.
bool is_ipv4(const std::string& text);

// Interface through which the kernel reaches the address. kBadInput when there is none. Thread: setup.
Result<Route> route_to(const std::string& ipv4);

// Sends GigE Vision's discovery command to the address: true if a camera answers, false after about 0.7 s (Aravis's own
// timeout is several seconds). Thread: setup.
bool answers_gvcp(const std::string& ipv4);

// Reads a camera's memory; address and length are multiples of 4, at most 512 bytes. Nothing when the camera refuses or
// is silent for 0.7 s. Thread: setup.
std::optional<std::vector<unsigned char>> read_memory(const std::string& ipv4, std::uint32_t address,
                                                      std::uint32_t bytes);

// Releases the control held by a crashed program of this computer, which the camera would keep until its heartbeat
// timeout (about 3 s). Cameras may state the holder's address and port in registers; only if no process has that port
// is a release sent from it. True when released. Thread: setup.
bool free_from_dead_program(const std::string& ipv4, const std::string& own_address);

// Makes the kernel drop packets to the stream socket from another address than the camera's (or another port, if
// source_port is not 0), and all except leaders, payload and trailers. This keeps them out of the socket buffer; forged
// sender addresses are left to gvsp::Assembler. False when the kernel refuses. Thread: setup.
bool filter_stream(int socket, const std::string& camera_address, std::uint16_t source_port);

// Checks that the descriptors and the thread that Aravis needs are available: without a socket it continues with none,
// and without a thread GLib aborts. Errors: kFailed. Thread: setup, or the connection manager's.
Status check_resources();

// Largest socket buffer granted by the kernel, bytes; 0: unknown. Thread: setup.
int largest_socket_buffer();

}  // namespace bolo::genicam
