#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>
#include <sstream>
#include <utility>

#include <fmt/format.h>

#include "src/rt/thread.hpp"
#include "tools/doctor/checks.hpp"

namespace bolo::tools::doctor {
namespace {

constexpr int kFrameBytes = 153'600;  // 640x120
constexpr int kJumbo = 8000;          // on a link with a smaller MTU a frame takes more than 20 packets
constexpr std::uint64_t kMiB = std::uint64_t{1} << 20;
constexpr std::uint64_t kLockedBytes = 256 * kMiB;  // locked by bolod at 640x480
constexpr int kLeastBacklog = 1000;

std::string bytes_text(std::uint64_t bytes) {
  if (bytes >= kMiB) return fmt::format("{:.1f} MiB", static_cast<double>(bytes) / static_cast<double>(kMiB));
  return fmt::format("{} KiB", bytes >> 10U);
}

template <typename Values>
std::string list(const Values& values) {
  return fmt::format("{}", fmt::join(values, ", "));
}

Check judged(Check check, Verdict verdict, std::string fix) {
  check.verdict = verdict;
  check.fix = std::move(fix);
  return check;
}
Check advice(Check check, std::string fix) { return judged(std::move(check), Verdict::kAdvice, std::move(fix)); }
Check problem(Check check, std::string fix) { return judged(std::move(check), Verdict::kProblem, std::move(fix)); }

Check unknown(Check check, const char* why) {
  check.found = why;
  return judged(std::move(check), Verdict::kUnknown, "");
}

Check found(Check check, std::string what) {
  check.found = std::move(what);
  return check;
}

Check receive_buffer(const Facts& facts, const Needs& needs) {
  Check check{"receive_buffer", "Receive buffer"};
  if (!facts.receive_buffer_max) return unknown(check, "net.core.rmem_max cannot be read");
  const auto have = static_cast<std::uint64_t>(*facts.receive_buffer_max);
  const auto want = static_cast<std::uint64_t>(needs.socket_buffer_bytes);
  check.found = "net.core.rmem_max allows " + bytes_text(have) + ", " + bytes_text(want) + " are asked for";
  if (have >= want) return check;
  return judged(check, have < 4 * kMiB ? Verdict::kProblem : Verdict::kAdvice,
                "sysctl -w net.core.rmem_max=" + std::to_string(want) +
                    ", and the same line in /etc/sysctl.d/60-bolo.conf; with less, frames are lost whenever this "
                    "computer is busy for a few ms");
}

Check backlog(const Facts& facts) {
  Check check{"backlog", "Packet backlog"};
  if (!facts.backlog) return unknown(check, "net.core.netdev_max_backlog is not known");
  check.found = std::to_string(*facts.backlog) + " packets may wait";
  if (*facts.backlog >= kLeastBacklog) return check;
  return advice(check, "sysctl -w net.core.netdev_max_backlog=" + std::to_string(kLeastBacklog));
}

const Interface* interface_of(const Facts& facts) {
  if (!facts.route_interface) return nullptr;
  const auto at = std::ranges::find(facts.interfaces, *facts.route_interface, &Interface::name);
  return at != facts.interfaces.end() ? &*at : nullptr;
}

Check mtu(const Facts& facts, const Needs& needs) {
  Check check{"mtu", "Packet size (MTU)"};
  if (facts.device) return found(check, "no packets: the camera is a video device");
  const Interface* leads = interface_of(facts);
  if (leads == nullptr) {
    return judged(found(check, "no camera is known, so neither is the interface to it"), Verdict::kUnknown,
                  "bolo doctor --address IP, or --config FILE");
  }
  const int packets = (kFrameBytes + leads->mtu - 1) / std::max(1, leads->mtu);
  check.found = fmt::format("{} carries {} bytes: {} packets for a frame of 640x120", leads->name, leads->mtu, packets);
  if (needs.packet_bytes > leads->mtu) {
    return problem(
        check, fmt::format("ip link set dev {0} mtu {1}, or packet_size = 0 in the configuration: {1} bytes do not fit",
                           leads->name, needs.packet_bytes));
  }
  if (leads->mtu < kJumbo) {
    return advice(check, "ip link set dev " + leads->name +
                             " mtu 9000, where adapter, switch and camera can: fewer packets, a fourth of the work");
  }
  return check;
}

Check firewall(const Facts& facts) {
  Check check{"firewall", "Firewall"};
  if (facts.firewalls.empty()) return found(check, "none is active");
  check.found = list(facts.firewalls) + (facts.firewalls.size() == 1 ? " is active" : " are active");
  const Interface* leads = interface_of(facts);
  if (leads != nullptr && leads->loopback) return check;
  check.verdict = Verdict::kAdvice;
  const std::string name = leads != nullptr ? leads->name : "the camera's interface";
  check.fix = "let UDP from the camera in: its stream comes to a port that changes. " + [&]() -> std::string {
    if (facts.firewalls.front() == "ufw") return "ufw allow in on " + name + " proto udp";
    if (facts.firewalls.front() == "firewalld") return "firewall-cmd --zone=trusted --change-interface=" + name;
    if (facts.firewalls.front() == "nftables") return "nft add rule inet filter input iifname " + name + " udp accept";
    return "iptables -I INPUT -i " + name + " -p udp -j ACCEPT";
  }();
  return check;
}

std::uint32_t number_of(const std::string& dotted) {
  unsigned a = 0, b = 0, c = 0, d = 0;
  if (std::sscanf(dotted.c_str(), "%u.%u.%u.%u", &a, &b, &c, &d) != 4) return 0;
  return a << 24U | b << 16U | c << 8U | d;
}

bool overlap(const Interface& a, const Interface& b) {
  const unsigned bits = std::min(a.prefix, b.prefix);
  const std::uint32_t mask = bits == 0 ? 0U : ~std::uint32_t{0} << (32U - bits);
  return (number_of(a.address) & mask) == (number_of(b.address) & mask);
}

// With two interfaces in one network the kernel chooses one, which may not be the camera's.
Check interfaces(const Facts& facts) {
  Check check{"interfaces", "Network interfaces"};
  std::vector<const Interface*> used;
  for (const Interface& i : facts.interfaces) {
    if (i.up && !i.loopback) used.push_back(&i);
  }
  std::vector<std::string> names;
  names.reserve(used.size());
  for (const Interface* i : used) names.push_back(fmt::format("{} {}/{}", i->name, i->address, i->prefix));
  check.found = names.empty() ? "only the loopback is up" : list(names);
  for (std::size_t i = 0; i < used.size(); ++i) {
    for (std::size_t k = i + 1; k < used.size(); ++k) {
      if (used[i]->name == used[k]->name || !overlap(*used[i], *used[k])) continue;
      return problem(
          check, used[i]->name + " and " + used[k]->name +
                     " are in one network, and packets leave by either: give the camera's one a network of its own");
    }
  }
  if (used.size() > 1) check.fix = "name the camera by its IP address in the configuration, not by its id";
  return check;
}

Check reverse_path(const Facts& facts) {
  Check check{"reverse_path", "Reverse path filter"};
  if (!facts.reverse_path_strict) return unknown(check, "rp_filter cannot be read");
  check.found = *facts.reverse_path_strict ? "strict (rp_filter = 1)" : "not strict";
  const auto outside = std::ranges::count_if(facts.interfaces, [](const Interface& i) { return i.up && !i.loopback; });
  if (!*facts.reverse_path_strict || outside < 2) return check;
  return advice(check,
                "a camera with an address of no local network is not heard: sysctl -w net.ipv4.conf.all.rp_filter=2");
}

Check priority(const Facts& facts, const Needs& needs) {
  Check check{"realtime", "Real-time priority"};
  check.found = "SCHED_FIFO up to " + std::to_string(std::min(facts.priority_limit, 99L));
  if (facts.priority_limit == 0) check.found = "not allowed";
  if (facts.priority_limit >= std::max(1, needs.realtime_priority)) return check;
  return judged(check, needs.realtime_priority > 0 ? Verdict::kProblem : Verdict::kAdvice,
                "LimitRTPRIO=" + std::to_string(std::max(20, needs.realtime_priority)) +
                    " in the service, or 'USER - rtprio 20' in /etc/security/limits.d/bolo.conf");
}

Check locked_memory(const Facts& facts) {
  Check check{"locked_memory", "Locked memory"};
  const bool unlimited = facts.memlock_limit == ~std::uint64_t{0};
  check.found = unlimited ? "unlimited" : bytes_text(facts.memlock_limit) + " may be locked";
  if (unlimited || facts.memlock_limit >= kLockedBytes) return check;
  return advice(
      check, "LimitMEMLOCK=infinity in the service, or 'USER - memlock unlimited' in /etc/security/limits.d/bolo.conf");
}

Check governor(const Facts& facts) {
  Check check{"governor", "CPU frequency"};
  if (facts.governors.empty()) return found(check, "no scaling here");
  const std::set<std::string> kinds(facts.governors.begin(), facts.governors.end());
  check.found = "governor " + list(kinds);
  if (kinds == std::set<std::string>{"performance"}) return check;
  return advice(check, "cpupower frequency-set -g performance: a processor that sleeps between frames wakes late");
}

Check isolation(const Facts& facts, const Needs& needs) {
  Check check{"isolation", "CPUs kept free"};
  check.found =
      fmt::format("{} CPUs, isolated: {}", facts.processors, facts.isolated.empty() ? "none" : list(facts.isolated));
  if (const Status cpus = rt::check_cpus(needs.cpus, facts.configured_cpus); !cpus)
    return problem(check, cpus.error().message);
  if (facts.processors < 2) {
    return advice(check, "one CPU is little: deblurring 640x120 at 200 frames/s fills most of it");
  }
  if (!facts.isolated.empty() && needs.cpus.empty()) {
    return advice(check,
                  "set pipeline.cpus = [" + list(facts.isolated) + "] to use them; nothing else runs there by itself");
  }
  return check;
}

Check shared_memory(const Facts& facts, const Needs& needs) {
  Check check{"shared_memory", "Shared memory"};
  if (!facts.shared_free) {
    return problem(found(check, "/dev/shm is not there"),
                   "mount -t tmpfs tmpfs /dev/shm; in a container give it --shm-size=256m");
  }
  const std::string free = *facts.shared_free == kNoLimit ? "no limit" : bytes_text(*facts.shared_free) + " free";
  check.found = free + " in /dev/shm, " + bytes_text(needs.shared_bytes) + " needed";
  if (*facts.shared_free >= needs.shared_bytes) return check;
  return problem(check, fmt::format("mount -o remount,size={}M /dev/shm; in a container --shm-size; or fewer shm.slots",
                                    (needs.shared_bytes >> 20U) * 2 + 64));
}

Check video(const Facts& facts, const Needs& needs) {
  Check check{"v4l2loopback", "Video device"};
  std::vector<std::string> ours;
  std::vector<std::string> others;
  for (const VideoDevice& device : facts.videos) {
    const bool loopback = device.driver.find("v4l2 loopback") != std::string::npos;
    (loopback ? ours : others).push_back(device.path + (device.driver.empty() ? "" : " (" + device.driver + ")"));
  }
  if (!ours.empty()) return found(check, "v4l2loopback: " + list(ours));
  check.found = facts.loopback_module ? "v4l2loopback is loaded, but has no device" : "v4l2loopback is not loaded";
  if (!others.empty()) check.found += "; other devices: " + list(others);
  check.verdict = needs.video ? Verdict::kProblem : Verdict::kAdvice;
  check.fix = facts.loopback_module
                  ? "modprobe -r v4l2loopback; modprobe v4l2loopback video_nr=10 exclusive_caps=1"
                  : "apt install v4l2loopback-dkms linux-headers-amd64; modprobe v4l2loopback video_nr=10 "
                    "exclusive_caps=1. Only for programs that want a camera device";
  return check;
}

Check usb(const Facts& facts) {
  Check check{"usb", "FLIR on USB"};
  std::vector<std::string> names;
  std::vector<std::string> closed;
  for (const UsbFound& device : facts.usb) {
    names.push_back(device.id + (device.product.empty() ? "" : " " + device.product));
    if (!device.writable) closed.push_back(device.node);
  }
  check.found = names.empty() ? "none" : list(names);
  if (closed.empty()) return check;
  return advice(
      check,
      list(closed) +
          " may not be written: join the group video, log in again and plug it in again; without the package bolo "
          "install its udev rule first: cp systemd/60-bolo-usb.rules /etc/udev/rules.d/; udevadm control --reload");
}

// Oldest supported release: the one this program was tested with.
Check library(const std::string& name, const std::string& title, const std::string& version, const char* least) {
  Check check{name, title, Verdict::kGood, version, ""};
  int have[3] = {};
  int want[3] = {};
  std::sscanf(version.c_str(), "%d.%d.%d", &have[0], &have[1], &have[2]);
  std::sscanf(least, "%d.%d.%d", &want[0], &want[1], &want[2]);
  if (!std::lexicographical_compare(have, have + 3, want, want + 3)) return check;
  return problem(check, std::string("at least ") + least + ": that of Debian 12");
}

Check camera(const Facts& facts, const Needs& needs) {
  Check check{"camera", "Camera"};
  if (facts.device && *facts.device) return found(check, **facts.device);
  if (facts.device) return problem(found(check, "its video device cannot be used"), facts.device->error().message);
  std::vector<std::string> names;
  for (const genicam::FoundCamera& c : facts.cameras) names.push_back(c.model + " " + c.serial + " at " + c.address);
  if (!needs.address.empty()) {
    check.found = needs.address + (facts.answers.value_or(false) ? " answers" : " does not answer");
    if (!names.empty()) check.found += "; found: " + list(names);
    if (facts.answers.value_or(false)) return check;
    return problem(
        check,
        "check power, cable and address: ping " + needs.address +
            "; the camera and this computer need addresses in one network (FLIR cameras fall back to 169.254.x.x)");
  }
  check.found = names.empty() ? "none answers" : list(names);
  if (names.empty()) {
    return advice(check, "to look for one on another network: bolo doctor --address IP; to try without: bolo fakecam");
  }
  if (names.size() > 1) {
    return advice(check, "several cameras answer: set source.address in each configuration");
  }
  return check;
}

Check clock(const Facts& facts) {
  Check check{"clock", "Time synchronisation"};
  if (!facts.clock) return unknown(check, "the kernel does not say");
  check.found = "the clock runs by itself: UTC of frames has no known error";
  if (facts.clock->synchronised) {
    check.found =
        fmt::format("the clock is synchronised, to {:.3g} ms", static_cast<double>(facts.clock->error_ns) * 1e-6);
  }
  if (!facts.time_services.empty()) check.found += "; " + list(facts.time_services);
  if (facts.clock->synchronised) return check;
  return advice(
      check,
      facts.time_services.empty()
          ? "apt install chrony (or systemd-timesyncd): frames can then be told apart from other sensors' by time"
          : "let it tell the kernel: 'rtcsync' in chrony.conf; of linuxptp, run phc2sys");
}

}  // namespace

std::string_view word(Verdict verdict) {
  constexpr std::array<std::string_view, 4> kWords{"good", "advice", "problem", "unknown"};
  return kWords[static_cast<std::size_t>(verdict)];
}

// Comma-separated fields: ..., name, stratum, time, offset of the system clock (s), ...
std::string describe_chrony(const std::string& tracking) {
  std::istringstream line(tracking);
  std::vector<std::string> fields;
  for (std::string field; std::getline(line, field, ',');) fields.push_back(field);
  constexpr std::size_t kFields = 14;
  if (fields.size() < kFields) return {};
  double offset_s = 0.0;
  if (std::sscanf(fields[4].c_str(), "%lf", &offset_s) != 1) return {};
  if (fields[2] == "0") return "chrony runs, but follows nothing yet";
  return fmt::format("chrony follows {} (stratum {}), {:.3g} ms away", fields[1].empty() ? fields[0] : fields[1],
                     fields[2], std::abs(offset_s) * 1e3);
}

// Lines of name and value, among them "master_offset 12" (ns) and "gmPresent true".
std::string describe_ptp(const std::string& time_status) {
  std::istringstream words(time_status);
  std::string offset_ns;
  bool present = false;
  for (std::string word; words >> word;) {
    if (word == "master_offset") words >> offset_ns;
    if (word == "gmPresent" && words >> word) present = word == "true";
  }
  if (offset_ns.empty()) return {};
  return present ? "ptp4l follows a grandmaster, " + offset_ns + " ns away" : "ptp4l runs, but follows no grandmaster";
}

std::vector<Check> judge(const Facts& facts, const Needs& needs) {
  return {camera(facts, needs),
          receive_buffer(facts, needs),
          mtu(facts, needs),
          interfaces(facts),
          firewall(facts),
          reverse_path(facts),
          backlog(facts),
          priority(facts, needs),
          locked_memory(facts),
          governor(facts),
          isolation(facts, needs),
          shared_memory(facts, needs),
          video(facts, needs),
          usb(facts),
          clock(facts),
          library("aravis", "Aravis", facts.aravis, "0.8.26"),
          library("hdf5", "HDF5", facts.hdf5, "1.10.8")};
}

}  // namespace bolo::tools::doctor
