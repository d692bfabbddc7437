// The pixels of a capture that `bolo deblur` solves and writes: all, a region, or single points.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::tools {

// Reads points, one `x,y` per line: column and row in the stored frame, px, rounded to the nearest pixel. Skips empty
// lines, lines that begin with #, and a first line `x,y` or `x_px,y_px`. Returns row-major indices in file order.
// kBadInput ("FILE:LINE: what"): a bad line, a point outside the frame, more points than pixels. Thread: setup.
Result<std::vector<std::uint32_t>> read_points(const std::filesystem::path& file, Geometry frame);

class PixelChoice {
 public:
  // A region within the frame, or points within it, or neither: the whole frame.
  PixelChoice(Geometry frame, std::optional<Region> region, std::vector<std::uint32_t> points);

  // Size of the written frames: the region's, or one row with a column per point.
  Geometry geometry() const;
  const Region& region() const { return region_; }
  const std::vector<std::uint32_t>& points() const { return points_; }
  int x_of(std::size_t i) const { return place(i).first; }
  int y_of(std::size_t i) const { return place(i).second; }

  // Copies the chosen pixels of a whole plane with `value_bytes` per value, row by row or point by point.
  void take(const void* plane, std::size_t value_bytes, void* out) const;
  // The same for the deblurred plane of the pipeline: a whole plane, or the points alone.
  void take_deblurred(const void* plane, std::size_t value_bytes, void* out) const;

 private:
  std::pair<int, int> place(std::size_t i) const;

  Geometry frame_;
  Region region_;
  std::vector<std::uint32_t> points_;
};

// "x,y,width,height"
std::string describe_region(const Region& region);

}  // namespace bolo::tools
