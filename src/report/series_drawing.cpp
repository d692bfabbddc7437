#include "src/report/series_drawing.hpp"

#include <algorithm>
#include <cmath>

#include "src/report/data_picture.hpp"
#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

constexpr double kBarsOfPlace = 0.78;  // what bars take of the room of a category

bool is_drawable(Point p) { return std::isfinite(p.x) && std::isfinite(p.y); }

std::size_t size_of(const Series& series) { return std::min(series.x.size(), series.y.size()); }

const char* name_of(Hue hue) { return colours_of(hue).name; }

// Of curves with several points on a column of pixels, the column's first, lowest, highest and last one.
std::vector<Point> thinned(const std::vector<Point>& points, double width) {
  if (static_cast<double>(points.size()) <= 4.0 * width) return points;
  std::vector<Point> out;
  const auto column = [](Point p) { return is_drawable(p) ? std::floor(p.x) : kNone; };
  for (std::size_t begin = 0; begin < points.size();) {
    std::size_t end = begin + 1;
    while (end < points.size() && column(points[end]) == column(points[begin])) ++end;
    std::vector<std::size_t> keep{begin, end - 1};
    for (std::size_t i = begin; i < end && is_drawable(points[begin]); ++i) {
      if (points[i].y < points[keep[0]].y) keep[0] = i;
      if (points[i].y > points[keep[1]].y) keep[1] = i;
    }
    keep.insert(keep.end(), {begin, end - 1});
    std::ranges::sort(keep);
    keep.erase(std::unique(keep.begin(), keep.end()), keep.end());
    for (const std::size_t i : keep) out.push_back(points[i]);
    begin = end;
  }
  return out;
}

std::string path_of(const std::vector<Point>& points) {
  std::string out;
  bool pen_down = false;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_drawable(points[i])) {
      pen_down = false;
      continue;
    }
    const bool alone = !pen_down && (i + 1 == points.size() || !is_drawable(points[i + 1]));
    out += format("%c%.1f %.1f%s", pen_down ? 'L' : 'M', points[i].x, points[i].y, alone ? "h.1" : "");
    pen_down = true;
  }
  return out;
}

std::vector<Point> points_of(const Series& series, const Placing& placing) {
  std::vector<Point> points;
  for (std::size_t i = 0; i < size_of(series); ++i) points.push_back(placing.at(series.x[i], series.y[i]));
  return points;
}

std::string line_svg(const Series& series, const std::vector<Point>& points, double width) {
  const std::string path = path_of(thinned(points, width));
  if (path.empty()) return {};
  return format("<path class=\"line s-%s%s\" stroke-width=\"%.1f\" d=\"", name_of(series.hue),
                series.dashed ? " dashed" : "", series.width) +
         path + "\"/>";
}

std::string dots_svg(const Series& series, const Placing& placing) {
  std::string out;
  const std::vector<Point> points = points_of(series, placing);
  const double radius = points.size() > 400 ? 1.6 : points.size() > 80 ? 2.4 : 3.6;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_drawable(points[i])) continue;
    out += format("<circle class=\"f-%s\" cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"/>", name_of(series.hue), points[i].x,
                  points[i].y, radius);
  }
  return out;
}

std::string bars_svg(const Plot& plot, const Series& series, std::size_t bar, const Placing& placing) {
  const auto bars = static_cast<double>(std::ranges::count(plot.series, Kind::kBars, &Series::kind));
  const double width = kBarsOfPlace / bars;
  std::string out;
  for (std::size_t i = 0; i < size_of(series); ++i) {
    const double middle = series.x[i] + (static_cast<double>(bar) - 0.5 * (bars - 1.0)) * width;
    const double half = 0.46 * width;  // a little air between two bars
    const Point a = placing.at(middle - half, series.base);
    const Point b = placing.at(middle + half, series.y[i]);
    if (!is_drawable(a) || !is_drawable(b)) continue;
    out += format("<rect class=\"f-%s\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"", name_of(series.hue),
                  std::min(a.x, b.x), std::min(a.y, b.y), std::max(std::abs(a.x - b.x), 1.0),
                  std::max(std::abs(a.y - b.y), 1.0));
    out += i < series.titles.size() ? "><title>" + escaped(series.titles[i]) + "</title></rect>" : "/>";
  }
  return out;
}

std::string band_svg(const Series& series, const Placing& placing) {
  std::string out;
  const std::size_t size = std::min(size_of(series), series.to.size());
  for (std::size_t begin = 0; begin < size;) {
    std::vector<Point> low;
    std::vector<Point> high;
    std::size_t i = begin;
    for (; i < size; ++i) {
      const Point a = placing.at(series.x[i], series.y[i]);
      const Point b = placing.at(series.x[i], series.to[i]);
      if (!is_drawable(a) || !is_drawable(b)) break;
      low.push_back(a);
      high.push_back(b);
    }
    if (low.size() > 1) {
      low.insert(low.end(), high.rbegin(), high.rend());
      out += format("<path class=\"band f-%s\" d=\"", name_of(series.hue)) + path_of(low) + "Z\"/>";
    }
    begin = i + 1;
  }
  return out;
}

}  // namespace

Point Placing::at(double x_value, double y_value) const noexcept {
  const double along_x = x.place(x_value);
  const double along_y = y.place(y_value);
  const double across = sideways ? along_y : along_x;
  const double upright = sideways ? along_x : along_y;
  return {across * width, (down ? upright : 1.0 - upright) * height};
}

std::string series_svg(const Plot& plot, const Series& series, std::size_t bar, const Placing& placing) {
  switch (series.kind) {
    case Kind::kLine:
      return line_svg(series, points_of(series, placing), placing.width);
    case Kind::kPoints:
      return dots_svg(series, placing);
    case Kind::kBars:
      return bars_svg(plot, series, bar, placing);
    case Kind::kBand:
      return band_svg(series, placing);
  }
  return {};
}

Point end_of(const Series& series, const Placing& placing) {
  for (std::size_t i = size_of(series); i-- > 0;) {
    const Point p = placing.at(series.x[i], series.y[i]);
    if (is_drawable(p)) return p;
  }
  return {kNone, kNone};
}

std::string plane_svg(const Plane& plane, const Placing& placing) {
  const std::string address = picture_address(plane);
  if (address.empty()) return {};
  const Point from = placing.at(-0.5, -0.5);
  const Point to = placing.at(plane.width - 0.5, plane.height - 0.5);
  return format(
             "<image class=\"plane\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" "
             "preserveAspectRatio=\"none\" href=\"",
             from.x, from.y, to.x - from.x, to.y - from.y) +
         address + "\"/>";
}

}  // namespace bolo::plot
