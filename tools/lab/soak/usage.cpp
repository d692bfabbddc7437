#include "tools/lab/soak/usage.hpp"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace bolo::tools::soak {
namespace {

constexpr double kMibPerKib = 1.0 / 1024.0;

double seconds(double ticks) { return ticks / static_cast<double>(sysconf(_SC_CLK_TCK)); }

int entries_of(const std::filesystem::path& folder) {
  std::error_code error;
  int n = 0;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) ++n;
  return n;
}

// Fields 14 and 15 of /proc/PID/stat; the second one, the name, may have blanks.
double cpu_seconds(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  const std::size_t name_end = line.rfind(')');
  if (name_end == std::string::npos) return 0.0;
  std::istringstream words(line.substr(name_end + 1));
  std::string word;
  double ticks = 0.0;
  for (int field = 3; field <= 15 && words >> word; ++field) {
    if (field >= 14) ticks += std::stod(word);
  }
  return seconds(ticks);
}

}  // namespace

std::optional<Usage> usage_of(pid_t pid) {
  const std::filesystem::path folder = "/proc/" + std::to_string(pid);
  std::ifstream in(folder / "smaps_rollup");
  Usage usage;
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string key;
    double kib = 0.0;
    if (!(words >> key >> kib)) continue;
    if (key == "Rss:") usage.rss_mib = kib * kMibPerKib;
    if (key == "Pss:") usage.pss_mib = kib * kMibPerKib;
    if (key == "Pss_Anon:") usage.private_mib = kib * kMibPerKib;
  }
  if (usage.rss_mib <= 0.0) return std::nullopt;
  usage.descriptors = entries_of(folder / "fd");
  usage.threads = entries_of(folder / "task");
  usage.cpu_s = cpu_seconds(folder / "stat");
  return usage;
}

double busy_s() {
  std::ifstream in("/proc/stat");
  std::string word;
  in >> word;  // "cpu": user, nice, system, idle, iowait, irq, softirq
  double ticks = 0.0;
  double value = 0.0;
  for (int field = 0; field < 7 && in >> value; ++field) {
    if (field != 1 && field != 3 && field != 4) ticks += value;
  }
  return seconds(ticks);
}

}  // namespace bolo::tools::soak
