#include <arpa/inet.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <linux/videodev2.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/timex.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdio>
#include <fstream>
#include <memory>
#include <sstream>
#include <thread>

#include <fmt/format.h>
#include <hdf5.h>

#include "drivers/genicam/network.hpp"
#include "drivers/shm/shm_reader.hpp"
#include "src/core/input_file.hpp"
#include "src/core/unique_fd.hpp"
#include "src/rt/thread.hpp"
#include "tools/doctor/checks.hpp"

namespace bolo::tools::doctor {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFlir = "09cb";

std::optional<int> number_of(const fs::path& file) {
  std::ifstream in(file);
  int value = 0;
  return in >> value ? std::optional(value) : std::nullopt;
}

std::vector<fs::path> entries_of(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> found;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    found.push_back(at->path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

// Parses "0-2,7", the kernel's notation for processors.
std::vector<int> processors_of(const std::string& text) {
  std::vector<int> list;
  std::istringstream parts(text);
  std::string part;
  while (std::getline(parts, part, ',')) {
    int first = 0;
    int last = 0;
    const int read = std::sscanf(part.c_str(), "%d-%d", &first, &last);
    if (read < 1) continue;
    for (int cpu = first; cpu <= (read == 2 ? last : first); ++cpu) list.push_back(cpu);
  }
  return list;
}

void gather_processors(const fs::path& root, Facts& facts) {
  facts.processors = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  facts.configured_cpus = rt::configured_cpus();
  const fs::path cpus = root / "sys/devices/system/cpu";
  for (const fs::path& cpu : entries_of(cpus)) {
    const std::string governor = first_line(cpu / "cpufreq/scaling_governor");
    if (!governor.empty()) facts.governors.push_back(governor);
  }
  facts.isolated = processors_of(first_line(cpus / "isolated"));
}

void gather_kernel(const fs::path& root, Facts& facts) {
  const fs::path net = root / "proc/sys/net";
  facts.receive_buffer_max = number_of(net / "core/rmem_max");
  facts.backlog = number_of(net / "core/netdev_max_backlog");
  if (const auto filter = number_of(net / "ipv4/conf/all/rp_filter")) facts.reverse_path_strict = *filter == 1;
  std::ifstream modules(root / "proc/modules");
  std::string line;
  while (std::getline(modules, line)) facts.loopback_module |= line.starts_with("v4l2loopback ");
}

// Finds firewalls that show in files; those in the kernel can be queried by root only.
void gather_firewalls(const fs::path& root, Facts& facts) {
  std::ifstream ufw(root / "etc/ufw/ufw.conf");
  std::string line;
  while (std::getline(ufw, line)) {
    if (line == "ENABLED=yes") facts.firewalls.emplace_back("ufw");
  }
  std::error_code error;
  if (fs::exists(root / "run/firewalld", error)) facts.firewalls.emplace_back("firewalld");
}

std::string output_of(const char* command) {
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command, "re"), &pclose);
  std::string text;
  std::array<char, 4096> part{};
  while (pipe != nullptr && std::fgets(part.data(), part.size(), pipe.get()) != nullptr) text += part.data();
  return text;
}

void ask_for_rules(Facts& facts) {
  if (geteuid() != 0 || !facts.firewalls.empty()) return;
  const auto refuses = [](const std::string& rules) {
    return rules.find("drop") != std::string::npos || rules.find("reject") != std::string::npos ||
           rules.find("DROP") != std::string::npos || rules.find("REJECT") != std::string::npos;
  };
  if (refuses(output_of("nft list ruleset 2>/dev/null"))) {
    facts.firewalls.emplace_back("nftables");
  } else if (refuses(output_of("iptables -S INPUT 2>/dev/null"))) {
    facts.firewalls.emplace_back("iptables");
  }
}

void gather_usb(const fs::path& root, Facts& facts) {
  for (const fs::path& device : entries_of(root / "sys/bus/usb/devices")) {
    if (first_line(device / "idVendor") != kFlir) continue;
    const std::string node = fmt::format("/dev/bus/usb/{:03}/{:03}", number_of(device / "busnum").value_or(0),
                                         number_of(device / "devnum").value_or(0));
    const fs::path file = root / fs::path(node).relative_path();
    facts.usb.push_back({std::string(kFlir) + ":" + first_line(device / "idProduct"), first_line(device / "product"),
                         node, access(file.c_str(), W_OK) == 0});
  }
}

void gather_videos(const fs::path& root, Facts& facts) {
  for (const fs::path& entry : entries_of(root / "sys/class/video4linux")) {
    const std::string name = entry.filename();
    VideoDevice device{"/dev/" + name, ""};
    const UniqueFd descriptor(::open((root / "dev" / name).c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
    v4l2_capability answer{};
    if (descriptor && ioctl(descriptor.get(), VIDIOC_QUERYCAP, &answer) == 0) {
      device.driver = reinterpret_cast<const char*>(answer.driver);
    }
    facts.videos.push_back(std::move(device));
  }
}

void gather_shared_memory(const fs::path& root, Facts& facts) {
  struct statvfs info {};
  if (statvfs((root / "dev/shm").c_str(), &info) != 0) return;
  facts.shared_free = info.f_blocks == 0 ? kNoLimit : std::uint64_t{info.f_bavail} * info.f_frsize;
}

std::string dotted(const sockaddr* address) {
  std::array<char, INET_ADDRSTRLEN> text{};
  inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, text.data(), text.size());
  return text.data();
}

void gather_interfaces(Facts& facts) {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return;
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
  const UniqueFd any(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) {
    if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET || i->ifa_netmask == nullptr) continue;
    Interface interface { i->ifa_name, dotted(i->ifa_addr) };
    const auto* mask = reinterpret_cast<const sockaddr_in*>(i->ifa_netmask);
    interface.prefix = static_cast<unsigned>(std::popcount(std::uint32_t{mask->sin_addr.s_addr}));
    interface.loopback = (i->ifa_flags & IFF_LOOPBACK) != 0;
    interface.up = (i->ifa_flags & IFF_UP) != 0;
    ifreq request{};
    interface.name.copy(request.ifr_name, IFNAMSIZ - 1);
    interface.mtu = ioctl(any.get(), SIOCGIFMTU, &request) == 0 ? request.ifr_mtu : 0;
    facts.interfaces.push_back(std::move(interface));
  }
}

// Tries realtime priority on a thread of its own: the kernel's answer is more reliable than limits and capabilities.
void try_limits(Facts& facts) {
  rlimit limit{};
  if (getrlimit(RLIMIT_RTPRIO, &limit) == 0) {
    facts.priority_limit = static_cast<long>(std::min<rlim_t>(limit.rlim_cur, 99));
  }
  bool allowed = false;
  std::thread([&allowed] {
    allowed = rt::apply_to_this_thread({.name = "bolo-doctor", .realtime_priority = 1}).has_value();
  }).join();
  if (!allowed) facts.priority_limit = 0;
  if (allowed && facts.priority_limit == 0) facts.priority_limit = 99;  // due to the capability
  if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0) {
    const bool unlimited = limit.rlim_cur == RLIM_INFINITY || geteuid() == 0;
    facts.memlock_limit = unlimited ? ~std::uint64_t{0} : limit.rlim_cur;
  }
}

// Programs that are not installed print nothing.
void ask_clock(Facts& facts) {
  timex state{};
  if (adjtimex(&state) >= 0) facts.clock = read_clock_state();
  std::error_code error;
  std::vector<std::string> words{describe_chrony(output_of("timeout 2 chronyc -c tracking 2>/dev/null"))};
  if (fs::exists("/run/ptp4l", error)) {
    words.push_back(describe_ptp(output_of("timeout 2 pmc -u -b 0 'GET TIME_STATUS_NP' 2>/dev/null")));
  }
  for (std::string& service : words) {
    if (!service.empty()) facts.time_services.push_back(std::move(service));
  }
}

void query_cameras(const CameraQuery& query, Facts& facts) {
  facts.cameras = genicam::find_cameras();
  std::string address = query.address;
  if (genicam::is_ipv4(address)) facts.answers = genicam::answers_gvcp(address);
  if (address.empty() && facts.cameras.size() == 1) address = facts.cameras.front().address;
  if (!genicam::is_ipv4(address)) {
    if (address.empty()) return;
    const auto named = [&](const genicam::FoundCamera& c) { return c.id == address || c.serial == address; };
    const auto at = std::find_if(facts.cameras.begin(), facts.cameras.end(), named);
    facts.answers = at != facts.cameras.end();
    if (at == facts.cameras.end()) return;
    address = at->address;
  }
  if (const auto route = genicam::route_to(address)) facts.route_interface = route->interface;
}

void find_versions(Facts& facts) {
  unsigned major = 0;
  unsigned minor = 0;
  unsigned release = 0;
  H5get_libversion(&major, &minor, &release);
  facts.hdf5 = std::to_string(major) + "." + std::to_string(minor) + "." + std::to_string(release);
  facts.aravis = genicam::aravis_version();
}

// The process that has this device open, "process 7 (bolod)"; empty: none that this user may inspect. Files of other
// names are not examined: they may be on a disk that hangs.
std::string holder_of(const fs::path& device) {
  struct stat wanted {};
  if (stat(device.c_str(), &wanted) != 0) return "";
  std::error_code error;
  const fs::path name = fs::canonical(device, error).filename();
  for (const fs::path& process : entries_of("/proc")) {
    for (const fs::path& file : entries_of(process / "fd")) {
      struct stat open {};
      if (fs::read_symlink(file, error).filename() != name) continue;
      if (stat(file.c_str(), &open) != 0 || !S_ISCHR(open.st_mode) || open.st_rdev != wanted.st_rdev) continue;
      return fmt::format("process {} ({})", process.filename().string(), first_line(process / "comm"));
    }
  }
  return "";
}

}  // namespace

Result<std::string> used_by(const Error& refused, const std::string& daemon) {
  const std::string device = refused.message.substr(0, refused.message.find(": "));
  std::string holder = holder_of(device);
  if (const auto stream = shm::ShmReader::open(daemon); holder.empty() && stream && !stream->closed()) {
    holder = fmt::format("process {} (bolod)", stream->header().writer_pid);
  }
  if (holder.empty()) return tl::unexpected<Error>(refused);
  if (!holder.ends_with("(bolod)")) return bad_input(device + ": " + holder + " uses it: end that program");
  return device + ": " + holder + " uses it";
}

Facts gather(const CameraQuery& query, const fs::path& root) {
  Facts facts;
  gather_processors(root, facts);
  gather_kernel(root, facts);
  gather_firewalls(root, facts);
  gather_usb(root, facts);
  gather_videos(root, facts);
  gather_shared_memory(root, facts);
  find_versions(facts);
  if (root != "/") return facts;
  gather_interfaces(facts);
  try_limits(facts);
  ask_for_rules(facts);
  ask_clock(facts);
  if (query.ask_network) query_cameras(query, facts);
  return facts;
}

}  // namespace bolo::tools::doctor
