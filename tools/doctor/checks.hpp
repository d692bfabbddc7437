// Faults of a host that keep frames from being sharp, each with its fix.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "drivers/genicam/genicam_source.hpp"
#include "src/core/clock.hpp"
#include "src/core/result.hpp"

namespace bolo::tools::doctor {

// --- Facts about this host, without judgement.

struct Interface {
  std::string name;
  std::string address;  // dotted decimal
  unsigned prefix = 0;  // network bits
  int mtu = 0;
  bool loopback = false;
  bool up = false;
  bool operator==(const Interface&) const = default;
};

struct VideoDevice {
  std::string path;
  std::string driver;  // empty: it could not be asked
};

struct UsbFound {
  std::string id;       // "09cb:1996"
  std::string product;  // may be empty
  std::string node;     // /dev/bus/usb/...
  bool writable = false;
};

inline constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};

// An empty optional: could not be determined.
struct Facts {
  std::optional<int> receive_buffer_max;  // net.core.rmem_max, bytes
  std::optional<int> backlog;             // net.core.netdev_max_backlog, packets
  std::vector<Interface> interfaces;
  std::optional<std::string> route_interface;  // on the route to the camera
  std::vector<std::string> firewalls;          // active ones: "ufw", "firewalld", "nftables", "iptables"
  std::optional<bool> reverse_path_strict;     // on the camera's interface, or on all

  int processors = 1;
  int configured_cpus = 1;             // including those switched off
  std::vector<std::string> governors;  // one per processor; empty: no frequency scaling here
  std::vector<int> isolated;           // processors
  long priority_limit = 0;             // RLIMIT_RTPRIO; 99 with CAP_SYS_NICE
  std::uint64_t memlock_limit = 0;     // bytes; all ones: no limit

  std::optional<std::uint64_t> shared_free;  // in /dev/shm, bytes; kNoLimit: as much as there is memory
  bool loopback_module = false;              // v4l2loopback is loaded
  std::vector<VideoDevice> videos;
  std::vector<UsbFound> usb;  // devices of FLIR

  std::string aravis;
  std::string hdf5;

  std::vector<genicam::FoundCamera> cameras;  // those that answered
  std::optional<bool> answers;                // whether the given address answered
  std::optional<Result<std::string>> device;  // if the camera is a video device: its name, or why it is unusable

  std::optional<ClockState> clock;
  std::vector<std::string> time_services;  // status reports of chrony, linuxptp
};

// The camera to look for on the network.
struct CameraQuery {
  std::string address;      // empty: any camera
  bool ask_network = true;  // false: sends nothing
};

// Reads the host below `root` (in tests not "/": only files) and queries the network; takes seconds. Thread: setup.
Facts gather(const CameraQuery& query, const std::filesystem::path& root = "/");

// For a video device that was refused as in use ("DEVICE: another program uses it ..."): names the program, as far as
// this user may see. Where the kernel does not tell, a running bolod of the name `daemon` is assumed. An error if it is
// unknown or not a bolod. Thread: any.
Result<std::string> used_by(const Error& refused, const std::string& daemon);

enum class Verdict {
  kGood,
  kAdvice,   // works, but less well than it could
  kProblem,  // frames will be lost, or nothing will work
  kUnknown,  // could not be checked: the reason is in `found`
};
std::string_view word(Verdict verdict);  // "good", "advice", "problem", "unknown"

struct Check {
  std::string name;   // stable identifier for programs: "receive_buffer"
  std::string title;  // "Receive buffer"
  Verdict verdict = Verdict::kGood;
  std::string found{};  // the finding
  std::string fix{};    // the remedy; empty if none is needed
};

// The daemon's demands on the host.
struct Needs {
  int socket_buffer_bytes = 8 << 20;
  int packet_bytes = 0;  // 0: the largest that the link carries
  int realtime_priority = 0;
  std::vector<int> cpus;           // on which deblurring runs
  std::uint64_t shared_bytes = 0;  // size of the frames' ring
  std::string address;             // of the camera; empty: any
  bool video = false;              // the daemon writes to a video device
};

// Describe the output of `chronyc -c tracking` and `pmc 'GET TIME_STATUS_NP'`; empty: not understood. Thread: any.
std::string describe_chrony(const std::string& tracking);
std::string describe_ptp(const std::string& time_status);

// Judges each fact; no side effects. Order: network, processor, memory, devices, libraries, camera. Thread: any.
std::vector<Check> judge(const Facts& facts, const Needs& needs);

}  // namespace bolo::tools::doctor
