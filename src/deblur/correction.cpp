#include "src/deblur/correction.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "src/deblur/kernels.hpp"

namespace bolo::deblur {
namespace {

constexpr double kLongestTau = 1.0;  // s, as in Settings

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

Status check_row_delay(const Settings& settings, const StreamFormat& input, const model::PixelMaps& maps) {
  const double span_s = maps.row_delay_s * input.row_step * (input.geometry.height - 1);
  if (std::isfinite(span_s) && std::abs(span_s) <= (settings.window - 1) * settings.period_s) return {};
  std::ostringstream text;
  text << "maps: row_delay_s is " << maps.row_delay_s << ": reading " << input.geometry.height
       << " rows would take longer than the window of " << settings.window << " frames";
  return bad_input(text.str());
}

Status check(const Settings& settings, const StreamFormat& input, const model::PixelMaps& maps) {
  const Geometry geometry = input.geometry;
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
  if (status) status = check_row_delay(settings, input, maps);
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

std::vector<float> padded(const std::vector<float>& map) {
  std::vector<float> copy = map;
  copy.resize(map.size() + kCorrectLanes, 0.0F);
  return copy;
}

}  // namespace

Result<Correction> Correction::create(const Settings& settings, const StreamFormat& input,
                                      const model::PixelMaps& maps) {
  if (const Status good = check(settings, input, maps); !good) return tl::unexpected<Error>(good.error());
  Correction correction;
  correction.type_ = input.type;
  correction.pixels_ = input.geometry.pixels();
  correction.kernel_ = correct_kernel(best_kernels().isa);
  correction.row_delay_ = maps.row_delay_s * input.row_step / settings.period_s;
  for (std::size_t gap = 0; gap < correction.nominal_decay_.size(); ++gap) {
    const double periods = static_cast<double>(gap) * settings.period_s;
    correction.nominal_decay_[gap] = static_cast<float>(std::exp(-periods / settings.tau_s));
  }
  correction.set_scale(input, maps);
  correction.set_lag(settings, maps);
  if (!maps.dead.empty()) correction.set_dead(input.geometry, maps.dead);
  return correction;
}

// kelvin = scale * value + shift becomes gain * kelvin + offset; as values: gain * value + (gain shift + offset -
// shift) / scale. Counts have neither scale nor shift.
void Correction::set_scale(const StreamFormat& input, const model::PixelMaps& maps) {
  if (maps.gain.empty() && maps.offset.empty()) return;
  const bool kelvin = input.scale.unit == Unit::kKelvin;
  const double scale = kelvin ? input.scale.scale : 1.0;
  const double shift = kelvin ? input.scale.offset : 0.0;
  const std::size_t pixels = input.geometry.pixels();
  gain_ = maps.gain.empty() ? std::vector<float>(pixels, 1.0F) : maps.gain;
  gain_ = padded(gain_);
  offset_.assign(pixels + kCorrectLanes, 0.0F);
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto gain = static_cast<double>(gain_[i]);
    const double offset = maps.offset.empty() ? 0.0 : static_cast<double>(maps.offset[i]);
    offset_[i] = static_cast<float>(((gain - 1.0) * shift + offset) / scale);
  }
}

void Correction::set_lag(const Settings& settings, const model::PixelMaps& maps) {
  if (maps.tau_s.empty()) return;
  const double nominal = std::exp(-settings.period_s / settings.tau_s);
  lag_.assign(maps.tau_s.size() + kCorrectLanes, 0.0F);
  decay_ = lag_;
  for (std::size_t i = 0; i < maps.tau_s.size(); ++i) {
    const double decay = std::exp(-settings.period_s / static_cast<double>(maps.tau_s[i]));
    lag_[i] = static_cast<float>((decay - nominal) / (1.0 - decay));
    decay_[i] = static_cast<float>(decay);
  }
}

void Correction::set_dead(Geometry geometry, const std::vector<std::uint8_t>& dead) {
  for (std::size_t pixel = 0; pixel < dead.size(); ++pixel) {
    if (pixel % kCell == 0) dead_before_.push_back(static_cast<std::uint32_t>(dead_.size()));
    if (dead[pixel] == 0) continue;
    const int x = static_cast<int>(pixel % static_cast<std::size_t>(geometry.width));
    const int y = static_cast<int>(pixel / static_cast<std::size_t>(geometry.width));
    std::vector<std::uint32_t> ring;
    for (int radius = 1; ring.empty(); ++radius) ring = good_ring(geometry, dead, x, y, radius);
    const std::size_t step = (ring.size() + kMostSources - 1) / kMostSources;
    std::vector<std::uint32_t> chosen;
    for (std::size_t i = 0; i < ring.size(); i += step) chosen.push_back(ring[i]);
    const auto first = static_cast<std::uint32_t>(groups_.size());
    const float share = 1.0F / static_cast<float>(chosen.size());
    for (std::size_t i = 0; i < chosen.size(); i += FillGroup::kPixels) {
      const std::size_t count = std::min(FillGroup::kPixels, chosen.size() - i);
      add_group(std::span<const std::uint32_t>(chosen).subspan(i, count), share);
    }
    dead_.push_back({static_cast<std::uint32_t>(pixel), first, static_cast<std::uint32_t>(groups_.size()) - first});
  }
}

void Correction::add_group(std::span<const std::uint32_t> pixels, float share) {
  FillGroup group;
  for (std::size_t k = 0; k < FillGroup::kPixels; ++k) {
    const std::uint32_t pixel = pixels[std::min(k, pixels.size() - 1)];
    group.pixel[k] = pixel;
    group.gain[k] = gain_.empty() ? 1.0F : gain_[pixel];
    group.offset[k] = gain_.empty() ? 0.0F : offset_[pixel];
    group.lag[k] = lag_.empty() ? 0.0F : lag_[pixel];
    group.decay[k] = lag_.empty() ? 0.0F : decay_[pixel];
    group.share[k] = k < pixels.size() ? share : 0.0F;
  }
  groups_.push_back(group);
}

PixelFactors Correction::factors(std::size_t pixel) const noexcept {
  const auto from = [pixel](const std::vector<float>& map) { return map.empty() ? nullptr : map.data() + pixel; };
  return {from(gain_), from(offset_), from(lag_), from(decay_)};
}

std::span<const DeadPixel> Correction::dead(std::size_t begin, std::size_t end) const noexcept {
  if (dead_.empty()) return {};
  std::size_t first = dead_before_[begin / kCell];
  while (first < dead_.size() && dead_[first].pixel < begin) ++first;
  std::size_t last = first;
  while (last < dead_.size() && dead_[last].pixel < end) ++last;
  return {dead_.data() + first, last - first};
}

}  // namespace bolo::deblur
