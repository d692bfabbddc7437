#include "tools/lab/soak/growth.hpp"

#include <algorithm>

#include "src/core/statistics.hpp"

namespace bolo::tools::soak {
namespace {

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
