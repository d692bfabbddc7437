#include "tools/deblur/gyro_file.hpp"

#include <algorithm>
#include <sstream>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include "src/core/clock.hpp"
#include "src/core/input_file.hpp"
#include "src/core/parse_text.hpp"

namespace bolo::tools {
namespace {

constexpr std::string_view kHeader = "t_s,x_rad_s,y_rad_s,z_rad_s";
constexpr double kLastTime_s = 4e9;  // beyond today's UTC

std::optional<GyroSample> sample_of(std::string_view line) {
  std::array<double, 4> values{};
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t comma = line.find(',');
    const bool last = i + 1 == values.size();
    const auto value = bolo::number_of(trimmed(line.substr(0, comma)));
    if (!value || last != (comma == std::string_view::npos)) return std::nullopt;
    values[i] = *value;
    line.remove_prefix(last ? 0 : comma + 1);
  }
  const GyroSample sample{to_ns(std::clamp(values[0], -1.0, kLastTime_s)), {values[1], values[2], values[3]}};
  if (values[0] < 0.0 || values[0] > kLastTime_s || !is_turn(sample.rate)) return std::nullopt;
  return sample;
}

}  // namespace

Result<std::vector<GyroSample>> read_gyro(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(std::string whole, read_input(file));
  std::istringstream in(std::move(whole));
  std::vector<GyroSample> samples;
  std::string text;
  bool first = true;
  for (int at = 1; std::getline(in, text); ++at) {
    const std::string_view line = trimmed(text);
    if (line.empty() || line.front() == '#' || (std::exchange(first, false) && line == kHeader)) continue;
    const auto sample = sample_of(line);
    if (!sample) {
      return bad_input(fmt::format("{}:{}: '{}' is no sample of a gyro; write {}, times from 0 s, rates up to {} rad/s",
                                   file.string(), at, line.substr(0, 80), kHeader, kFastestTurn));
    }
    if (!samples.empty() && sample->time_ns <= samples.back().time_ns) {
      return bad_input(fmt::format("{}:{}: time does not rise from the line before", file.string(), at));
    }
    samples.push_back(*sample);
  }
  if (samples.empty()) return bad_input(fmt::format("{}: no samples; write lines of {}", file.string(), kHeader));
  return samples;
}

std::int64_t GyroOfCapture::time_of(const FrameMeta& frame) const noexcept {
  const std::vector<double>& host = reader_->t_host();
  const std::vector<double>& t = reader_->t();
  if (host.size() != t.size()) return frame.camera_ns;
  const auto at = std::ranges::lower_bound(t, frame.camera_ns, {}, to_ns);
  return at == t.end() ? frame.camera_ns : to_ns(host[static_cast<std::size_t>(at - t.begin())]);
}

}  // namespace bolo::tools
