// Faults of a host that keep a camera's frames from being sharp, each with its fix.
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

// --- What is so on this host, without judgement.

struct Interface {
  std::string name;
  std::string address;  // dotted
  unsigned prefix = 0;  // bits of the network
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

// An empty optional: it could not be found out.
struct Facts {
  std::optional<int> receive_buffer_max;  // net.core.rmem_max, bytes
  std::optional<int> backlog;             // net.core.netdev_max_backlog, packets
  std::vector<Interface> interfaces;
  std::optional<std::string> route_interface;  // that leads to the camera
  std::vector<std::string> firewalls;          // that are active: "ufw", "firewalld", "nftables", "iptables"
  std::optional<bool> reverse_path_strict;     // of the camera's interface or all

  int processors = 1;
  int configured_cpus = 1;             // with those that are switched off
  std::vector<std::string> governors;  // one a processor; empty: no frequency scaling here
  std::vector<int> isolated;           // processors
  long priority_limit = 0;             // RLIMIT_RTPRIO; 99 and more with CAP_SYS_NICE
  std::uint64_t memlock_limit = 0;     // bytes; all ones: none

  std::optional<std::uint64_t> shared_free;  // of /dev/shm, bytes; kNoLimit: as much as there is memory
  bool loopback_module = false;              // v4l2loopback is loaded
  std::vector<VideoDevice> videos;
  std::vector<UsbFound> usb;  // devices of FLIR

  std::string aravis;
  std::string hdf5;

  std::vector<genicam::FoundCamera> cameras;  // that answered
  std::optional<bool> answers;                // the address that was asked for
  std::optional<Result<std::string>> device;  // the camera is a video device: what it is, or why it cannot be used

  std::optional<ClockState> clock;
  std::vector<std::string> time_services;  // their reports: chrony, linuxptp
};

// The camera to look for on the network.
struct CameraQuery {
  std::string address;      // empty: whoever answers
  bool ask_network = true;  // false: nothing is sent
};

// Reads the host below `root` ("/"; another one for tests, which then sees files only) and asks the network. Takes up
// to some seconds. Thread: setup.
Facts gather(const CameraQuery& query, const std::filesystem::path& root = "/");

// Of a video device that was refused because another program has it ("DEVICE: another program uses it ..."): which one,
// as far as this user may see. An error unless it is a bolod; a living one of the configuration's name, `daemon`, is
// taken to be it where the kernel does not tell. Thread: any.
Result<std::string> used_by(const Error& refused, const std::string& daemon);

enum class Verdict {
  kGood,
  kAdvice,   // works, but less well than it could
  kProblem,  // frames will be lost, or nothing will work
  kUnknown,  // could not be checked: `found` has the reason
};
std::string_view word(Verdict verdict);  // "good", "advice", "problem", "unknown"

struct Check {
  std::string name;   // stable, for programs: "receive_buffer"
  std::string title;  // "Receive buffer"
  Verdict verdict = Verdict::kGood;
  std::string found{};  // what is so
  std::string fix{};    // what to do; empty where nothing is
};

// The daemon's demands on the host.
struct Needs {
  int socket_buffer_bytes = 8 << 20;
  int packet_bytes = 0;  // 0: the largest that the link carries
  int realtime_priority = 0;
  std::vector<int> cpus;           // that deblurring keeps to
  std::uint64_t shared_bytes = 0;  // of the frames' ring
  std::string address;             // of the camera; empty: any that answers
  bool video = false;              // a video device is wanted
};

// Descriptions of the output of `chronyc -c tracking` and `pmc 'GET TIME_STATUS_NP'`; empty: it cannot be read. Thread:
// any.
std::string describe_chrony(const std::string& tracking);
std::string describe_ptp(const std::string& time_status);

// Pure: judges each fact. Order: the network, the processor, memory, devices, libraries, the camera. Thread: any.
std::vector<Check> judge(const Facts& facts, const Needs& needs);

}  // namespace bolo::tools::doctor
