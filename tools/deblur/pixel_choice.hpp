// Which pixels of a capture `bolo deblur` solves and writes: all, a region, or single points.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::tools {

// Reads points, one `x,y` a line in pixels, column and row of the stored frame; decimals mean the nearest pixel. Empty
// lines, lines that begin with #, and a first line `x,y` or `x_px,y_px` are passed over. Row-major indices in the order
// of the file. A bad line and a point outside the frame are bad input: "FILE:LINE: what"; so are more points than the
// frame has pixels. Thread: setup.
Result<std::vector<std::uint32_t>> read_points(const std::filesystem::path& file, Geometry frame);

class PixelChoice {
 public:
  // A region inside the frame, or points inside it, or neither: the whole frame.
  PixelChoice(Geometry frame, std::optional<Region> region, std::vector<std::uint32_t> points);

  // Of the frames that are written: the region's size, or 1 row with a column for each point.
  Geometry geometry() const;
  const Region& region() const { return region_; }
  const std::vector<std::uint32_t>& points() const { return points_; }
  int x_of(std::size_t i) const { return place(i).first; }
  int y_of(std::size_t i) const { return place(i).second; }

  // The chosen pixels of a whole plane of values of `value_bytes`, row after row, or point after point.
  void take(const void* plane, std::size_t value_bytes, void* out) const;
  // The same of what the pipeline publishes as deblurred: a whole plane, or with points these alone.
  void take_deblurred(const void* plane, std::size_t value_bytes, void* out) const;

 private:
  // Column and row in the frame of chosen pixel `i`.
  std::pair<int, int> place(std::size_t i) const;

  Geometry frame_;
  Region region_;
  std::vector<std::uint32_t> points_;
};

// "x,y,width,height"
std::string describe_region(const Region& region);

}  // namespace bolo::tools
