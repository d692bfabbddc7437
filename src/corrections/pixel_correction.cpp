#include "src/corrections/pixel_correction.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string_view>
#include <utility>

namespace bolo::corrections {
namespace {

constexpr double kLongestTau = 1.0;       // s, as in Settings
constexpr std::uint64_t kForgotten = 64;  // periods without a frame after which it restarts
constexpr std::size_t kMostSources = 64;  // of a dead pixel; of a ring with more, evenly spaced ones are used

// "maps: tau_s in row 3, column 17 is nan, must be ..."
template <typename T>
Status check_map(std::string_view name, const std::vector<T>& map, Geometry geometry, std::string_view wanted,
                 bool (*good)(double)) {
  if (map.empty()) return {};
  std::ostringstream text;
  text << "maps: " << name;
  if (map.size() != geometry.pixels()) {
    text << " has " << map.size() << " values, but the stream's frames are " << geometry.width << "x" << geometry.height
         << " (" << geometry.pixels() << "); give the maps of this frame size";
    return bad_input(text.str());
  }
  const auto wrong = std::find_if(map.begin(), map.end(), [good](T v) { return !good(static_cast<double>(v)); });
  if (wrong == map.end()) return {};
  const auto at = static_cast<std::size_t>(wrong - map.begin());
  const auto width = static_cast<std::size_t>(geometry.width);
  text << " in row " << at / width << ", column " << at % width << " is " << static_cast<double>(*wrong) << ", must be "
       << wanted;
  return bad_input(text.str());
}

Status check(Geometry geometry, const model::PixelMaps& maps) {
  if (maps.geometry != Geometry{} && maps.geometry != geometry) {
    std::ostringstream text;
    text << "maps are for frames of " << maps.geometry.width << "x" << maps.geometry.height << ", but the stream's are "
         << geometry.width << "x" << geometry.height << "; give the maps of this frame size";
    return bad_input(text.str());
  }
  const auto finite = [](double v) { return std::isfinite(v); };
  const auto positive = [](double v) { return std::isfinite(v) && v > 0.0; };
  Status status = check_map("tau_s", maps.tau_s, geometry, "above 0 and below 1 s",
                            [](double v) { return v > 0.0 && v < kLongestTau; });
  if (status) status = check_map("gain", maps.gain, geometry, "a number above 0", positive);
  if (status) status = check_map("offset", maps.offset, geometry, "a number", finite);
  if (status) {
    status = check_map("dead", maps.dead, geometry, "0 or 1", [](double v) { return v == 0.0 || v == 1.0; });
  }
  if (status && !maps.dead.empty() && std::find(maps.dead.begin(), maps.dead.end(), 0) == maps.dead.end()) {
    status = bad_input("maps: every pixel is dead");
  }
  return status;
}

// Good pixels at the Chebyshev distance `radius`, in row-major order.
std::vector<std::uint32_t> good_ring(Geometry g, const std::vector<std::uint8_t>& dead, int x, int y, int radius) {
  std::vector<std::uint32_t> found;
  for (int row = std::max(0, y - radius); row <= std::min(g.height - 1, y + radius); ++row) {
    const bool edge = std::abs(row - y) == radius;
    for (int column = x - radius; column <= x + radius; column += edge ? 1 : 2 * radius) {
      if (column < 0 || column >= g.width) continue;
      const auto pixel =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(column);
      if (dead[pixel] == 0) found.push_back(static_cast<std::uint32_t>(pixel));
    }
  }
  return found;
}

}  // namespace

Result<PixelCorrection> PixelCorrection::create(const deblur::Settings& settings, const StreamFormat& input,
                                                const model::PixelMaps& maps) {
  RETURN_IF_ERROR(check(input.geometry, maps));
  PixelCorrection correction;
  correction.ratio_ = settings.period_s / settings.tau_s;
  if (!maps.gain.empty() || !maps.offset.empty()) correction.set_scale(input, maps);
  if (!maps.tau_s.empty()) correction.set_lag(settings, maps);
  if (!maps.dead.empty()) correction.set_dead(input.geometry, maps.dead);
  return correction;
}

// kelvin = scale * value + shift becomes gain * kelvin + offset; as values: gain * value + (gain shift + offset -
// shift) / scale. Counts have neither scale nor shift.
void PixelCorrection::set_scale(const StreamFormat& input, const model::PixelMaps& maps) {
  const bool kelvin = input.scale.unit == Unit::kKelvin;
  const double scale = kelvin ? input.scale.scale : 1.0;
  const double shift = kelvin ? input.scale.offset : 0.0;
  const std::size_t pixels = input.geometry.pixels();
  gain_ = maps.gain.empty() ? std::vector<float>(pixels, 1.0F) : maps.gain;
  offset_.assign(pixels, 0.0F);
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto gain = static_cast<double>(gain_[i]);
    const double offset = maps.offset.empty() ? 0.0 : static_cast<double>(maps.offset[i]);
    offset_[i] = static_cast<float>(((gain - 1.0) * shift + offset) / scale);
  }
}

void PixelCorrection::set_lag(const deblur::Settings& settings, const model::PixelMaps& maps) {
  const double nominal = std::exp(-ratio_);
  lag_.assign(maps.tau_s.size(), 0.0F);
  decay_ = before_ = added_ = lag_;
  for (std::size_t i = 0; i < maps.tau_s.size(); ++i) {
    const double decay = std::exp(-settings.period_s / static_cast<double>(maps.tau_s[i]));
    lag_[i] = static_cast<float>((decay - nominal) / (1.0 - decay));
    decay_[i] = static_cast<float>(decay);
  }
}

void PixelCorrection::set_dead(Geometry geometry, const std::vector<std::uint8_t>& dead) {
  for (std::size_t pixel = 0; pixel < dead.size(); ++pixel) {
    if (dead[pixel] == 0) continue;
    const int x = static_cast<int>(pixel % static_cast<std::size_t>(geometry.width));
    const int y = static_cast<int>(pixel / static_cast<std::size_t>(geometry.width));
    std::vector<std::uint32_t> ring;
    for (int radius = 1; ring.empty(); ++radius) ring = good_ring(geometry, dead, x, y, radius);
    const std::size_t step = (ring.size() + kMostSources - 1) / kMostSources;
    const auto first = static_cast<std::uint32_t>(sources_.size());
    for (std::size_t i = 0; i < ring.size(); i += step) sources_.push_back(ring[i]);
    dead_.push_back({static_cast<std::uint32_t>(pixel), first, static_cast<std::uint32_t>(sources_.size())});
  }
}

void PixelCorrection::begin(std::uint64_t periods) noexcept {
  periods_ = periods > kForgotten ? 0 : periods;
  nominal_decay_ = static_cast<float>(std::exp(-ratio_ * static_cast<double>(periods_)));
}

void PixelCorrection::apply(float* values, PixelRange pixels) noexcept {
  for (std::size_t begin = pixels.begin; begin < pixels.end; begin += kPixelsAtOnce) {
    const PixelRange some{begin, std::min(begin + kPixelsAtOnce, pixels.end)};
    if (!gain_.empty()) scale(values, some);
    if (!lag_.empty()) equalise(values, some);
  }
}

void PixelCorrection::scale(float* values, PixelRange pixels) const noexcept {
  const float* const gain = gain_.data();
  const float* const offset = offset_.data();
  for (std::size_t i = pixels.begin; i < pixels.end; ++i) values[i] = gain[i] * values[i] + offset[i];
}

void PixelCorrection::equalise(float* values, PixelRange pixels) noexcept {
  const float* const lag = lag_.data();
  float* const before = before_.data();
  float* const added = added_.data();
  if (periods_ == 0) {
    std::copy(values + pixels.begin, values + pixels.end, before + pixels.begin);
    std::fill(added + pixels.begin, added + pixels.end, 0.0F);
    return;
  }
  if (periods_ > 1) return equalise_over_gap(values, pixels);
  for (std::size_t i = pixels.begin; i < pixels.end; ++i) {
    const float value = values[i];
    added[i] = nominal_decay_ * added[i] + lag[i] * (value - before[i]);
    before[i] = value;
    values[i] = value + added[i];
  }
}

void PixelCorrection::equalise_over_gap(float* values, PixelRange pixels) noexcept {
  for (std::size_t i = pixels.begin; i < pixels.end; ++i) {
    const float power = std::pow(decay_[i], static_cast<float>(periods_));
    const float value = values[i];
    added_[i] = nominal_decay_ * added_[i] + (power - nominal_decay_) / (1.0F - power) * (value - before_[i]);
    before_[i] = value;
    values[i] = value + added_[i];
  }
}

void PixelCorrection::finish(float* values) noexcept {
  for (const Dead& dead : dead_) {
    float sum = 0.0F;
    for (std::uint32_t i = dead.first; i < dead.end; ++i) sum += values[sources_[i]];
    values[dead.pixel] = sum / static_cast<float>(dead.end - dead.first);
  }
}

Made pixel_correction(const Setup& setup, const StreamFormat& input) {
  ASSIGN_OR_RETURN(auto made, PixelCorrection::create(setup.settings, input, setup.maps));
  if (!made.changes_samples()) return nullptr;
  return std::make_unique<PixelCorrection>(std::move(made));
}

}  // namespace bolo::corrections
