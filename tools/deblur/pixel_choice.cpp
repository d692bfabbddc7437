#include "tools/deblur/pixel_choice.hpp"

#include <cmath>
#include <cstring>
#include <string_view>

#include <fmt/format.h>

#include "src/core/number_rows.hpp"

namespace bolo::tools {
namespace {

// Index of the pixel at a point.
Result<std::uint32_t> parse_point(std::string_view line, Geometry frame) {
  const auto point = numbers_of<2>(line);
  if (!point) return bad_input(fmt::format("'{:.60}' is not a point; write x,y in pixels", line));
  const double column = std::round((*point)[0]);
  const double row = std::round((*point)[1]);
  if (column < 0.0 || column >= frame.width || row < 0.0 || row >= frame.height) {
    return bad_input(fmt::format("point {} is outside the frame of {}x{}", line, frame.width, frame.height));
  }
  return static_cast<std::uint32_t>(row) * static_cast<std::uint32_t>(frame.width) + static_cast<std::uint32_t>(column);
}

}  // namespace

Result<std::vector<std::uint32_t>> read_points(const std::filesystem::path& file, Geometry frame) {
  std::vector<std::uint32_t> points;
  const auto too_many = [&] { return points.size() > frame.pixels(); };
  const Status read = read_rows(file, [&](std::string_view line, bool first) -> Status {
    if (first && (line == "x,y" || line == "x_px,y_px")) return {};
    ASSIGN_OR_RETURN(points.emplace_back(), parse_point(line, frame));
    return too_many() ? bad_input("too many") : Status{};  // at once: a file may have millions
  });
  if (too_many()) {
    return bad_input(fmt::format("{}: more points than the {}x{} pixels of a frame; give each once", file.string(),
                                 frame.width, frame.height));
  }
  RETURN_IF_ERROR(read);
  if (points.empty()) return bad_input(file.string() + ": no points; write one x,y in pixels a line");
  return points;
}

PixelChoice::PixelChoice(Geometry frame, std::optional<Region> region, std::vector<std::uint32_t> points)
    : frame_(frame), region_(region.value_or(Region{0, 0, frame.width, frame.height})), points_(std::move(points)) {}

Geometry PixelChoice::geometry() const {
  if (points_.empty()) return {region_.width, region_.height};
  return {static_cast<int>(points_.size()), 1};
}

std::pair<int, int> PixelChoice::place(std::size_t i) const {
  if (!points_.empty()) {
    const auto width = static_cast<std::uint32_t>(frame_.width);
    return {static_cast<int>(points_[i] % width), static_cast<int>(points_[i] / width)};
  }
  const auto width = static_cast<std::size_t>(region_.width);
  return {region_.x + static_cast<int>(i % width), region_.y + static_cast<int>(i / width)};
}

void PixelChoice::take(const void* plane, std::size_t value_bytes, void* out) const {
  const auto* from = static_cast<const std::byte*>(plane);
  auto* to = static_cast<std::byte*>(out);
  for (const std::uint32_t point : points_) {
    std::memcpy(to, from + point * value_bytes, value_bytes);
    to += value_bytes;
  }
  if (!points_.empty()) return;
  const auto width = static_cast<std::size_t>(region_.width);
  for (std::size_t i = 0; i < geometry().pixels(); i += width, to += width * value_bytes) {
    const auto [x, y] = place(i);
    std::memcpy(to, from + static_cast<std::size_t>(y * frame_.width + x) * value_bytes, width * value_bytes);
  }
}

void PixelChoice::take_deblurred(const void* plane, std::size_t value_bytes, void* out) const {
  if (points_.empty()) return take(plane, value_bytes, out);
  std::memcpy(out, plane, points_.size() * value_bytes);
}

std::string describe_region(const Region& r) { return fmt::format("{},{},{},{}", r.x, r.y, r.width, r.height); }

}  // namespace bolo::tools
