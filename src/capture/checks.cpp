// Rules that both file formats and the writer share.
#include <cmath>
#include <utility>

#include "src/capture/contents.hpp"
#include "src/core/statistics.hpp"

namespace bolo::capture {
namespace {

using h5::text;

constexpr double kPeriodTolerance = 0.2;
constexpr double kLongestPeriod_s = 1.0;  // no thermal camera streams slower than a frame a second

std::string value_at(std::size_t index, double value) {
  return "/t: value " + std::to_string(index) + " (" + text(value) + ")";
}

}  // namespace

Status check_times(const std::vector<double>& t) {
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (!std::isfinite(t[i])) return bad_input(value_at(i, t[i]) + " is not a finite number of seconds");
    if (i > 0 && t[i] <= t[i - 1]) {
      return bad_input(value_at(i, t[i]) + " is not above the one before (" + text(t[i - 1]) +
                       "); the frames' times must rise");
    }
  }
  return {};
}

double median_step(const std::vector<double>& t) {
  if (t.size() < 2) return 0.0;
  std::vector<double> step(t.size() - 1);
  for (std::size_t i = 0; i + 1 < t.size(); ++i) step[i] = t[i + 1] - t[i];
  return median(std::move(step));
}

void check_plausible(Contents& contents) {
  const double period_s = contents.info.format.frame_period_s;
  const double median_s = median_step(contents.t);
  if (median_s > kLongestPeriod_s) {
    contents.warnings.push_back("/t rises by " + text(median_s) +
                                " a frame: it looks like milliseconds, not seconds (" + text(median_s) + " ms is " +
                                text(1e3 / median_s) + " frames a second); divide /t and frame_period_s by 1000");
  } else if (period_s > kLongestPeriod_s) {
    contents.warnings.push_back("frame_period_s is " + text(period_s) + ": it looks like milliseconds, not seconds");
  }
  if (median_s > 0.0 && std::abs(period_s - median_s) > kPeriodTolerance * median_s) {
    contents.warnings.push_back("frame_period_s is " + text(period_s) + " s but /t rises by " + text(median_s) +
                                " s a frame (median)");
  }
}

Status check_format_values(const StreamFormat& format) {
  if (!(format.frame_period_s > 0.0) || !std::isfinite(format.frame_period_s)) {
    return bad_input("root attribute 'frame_period_s' is " + text(format.frame_period_s) +
                     "; expected seconds above 0");
  }
  if (format.scale.scale == 0.0 || !std::isfinite(format.scale.scale)) {
    return bad_input("root attribute 'scale' is " + text(format.scale.scale) +
                     "; expected a number other than 0 (kelvin = scale * value + offset)");
  }
  if (!std::isfinite(format.scale.offset)) return bad_input("root attribute 'offset' is not finite");
  if (format.row_step < 1) {
    return bad_input("root attribute 'row_step' is " + std::to_string(format.row_step) +
                     "; expected a whole number of at least 1");
  }
  return {};
}

}  // namespace bolo::capture
