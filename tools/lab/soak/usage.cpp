#include "tools/lab/soak/usage.hpp"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "src/core/statistics.hpp"

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

constexpr std::size_t kFewest = 10;
constexpr std::size_t kMostForSlope = 200;  // readings; their pairs are 20,000
constexpr double kSecondsPerHour = 3600.0;

double median(const std::vector<Reading>& readings, std::size_t from, std::size_t to) {
  std::vector<double> values;
  for (std::size_t i = from; i < to; ++i) values.push_back(readings[i].value);
  return quantile(values, 0.5);
}

double theil_sen(const std::vector<Reading>& readings) {
  const std::size_t step = std::max<std::size_t>(1, readings.size() / kMostForSlope);
  std::vector<double> slopes;
  for (std::size_t i = 0; i < readings.size(); i += step) {
    for (std::size_t j = i + step; j < readings.size(); j += step) {
      slopes.push_back((readings[j].value - readings[i].value) / (readings[j].at_s - readings[i].at_s));
    }
  }
  return quantile(slopes, 0.5);
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

Growth growth_of(const std::vector<Reading>& readings, double settle_s) {
  Growth growth;
  if (readings.empty()) return growth;
  const double from_s = readings.front().at_s + settle_s;
  const auto begin = std::ranges::find_if(readings, [from_s](const Reading& r) { return r.at_s >= from_s; });
  const std::vector<Reading> rest(begin, readings.end());
  if (rest.size() < kFewest || rest.back().at_s - rest.front().at_s < settle_s) return growth;
  const std::size_t fifth = std::max<std::size_t>(1, rest.size() / 5);
  growth.first = median(rest, 0, fifth);
  growth.last = median(rest, rest.size() - fifth, rest.size());
  growth.slope_per_hour = theil_sen(rest) * kSecondsPerHour;
  growth.judged = true;
  return growth;
}

bool grows(const Growth& growth, double span_s, double limit) {
  return growth.judged && growth.by() >= limit && growth.slope_per_hour * span_s / kSecondsPerHour >= limit / 2;
}

}  // namespace bolo::tools::soak
