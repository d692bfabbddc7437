#include "src/diagnose/report/plot.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace bolo::diagnose {
namespace {

constexpr std::size_t kMostPoints = 1500;

struct Point {
  double x = 0.0;
  double y = 0.0;
};

// The points that can be drawn, in the axes' units. Of very long curves the lowest and the highest of each stretch.
std::vector<Point> points_of(const Curve& curve, const PlotScale& scale) {
  std::vector<Point> all;
  for (std::size_t i = 0; i < std::min(curve.x.size(), curve.y.size()); ++i) {
    const Point point{curve.x[i] * scale.x_factor, curve.y[i] * scale.y_factor};
    const bool drawable = !scale.logarithmic || (point.x > 0.0 && point.y > 0.0);
    if (std::isfinite(point.x) && std::isfinite(point.y) && drawable) all.push_back(point);
  }
  if (all.size() <= kMostPoints) return all;
  std::vector<Point> thin;
  const std::size_t stretch = 2 * all.size() / kMostPoints + 1;
  for (std::size_t i = 0; i < all.size(); i += stretch) {
    const auto begin = all.begin() + static_cast<std::ptrdiff_t>(i);
    const auto end = all.begin() + static_cast<std::ptrdiff_t>(std::min(all.size(), i + stretch));
    const auto [low, high] = std::minmax_element(begin, end, [](const Point& a, const Point& b) { return a.y < b.y; });
    thin.push_back(low < high ? *low : *high);
    if (low != high) thin.push_back(low < high ? *high : *low);
  }
  return thin;
}

std::string path_of(const std::vector<Point>& points, const Axis& x, const Axis& y, bool sideways, bool dots) {
  std::string out;
  for (const Point& point : points) {
    const double across = 1000.0 * (sideways ? y.place(point.y) : x.place(point.x));
    const double down = sideways ? 1000.0 * x.place(point.x) : 1000.0 * (1.0 - y.place(point.y));
    out += format("%s%.1f %.1f%s", dots || out.empty() ? "M" : "L", across, down, dots ? "h0" : "");
  }
  return out;
}

std::string legend(const std::vector<Series>& series) {
  std::string out = "<div class=legend>";
  for (const Series& one : series) {
    out += format("<span><i class=\"key %s\"></i>%s</span>", one.look, escaped(one.label).c_str());
  }
  return out + "</div>";
}

}  // namespace

std::string framed(const Frame& frame, const std::string& inside) {
  std::string rows;
  std::string columns;
  std::string grid;
  for (const double tick : frame.y.ticks(4)) {
    const double top = frame.y_down ? frame.y.place(tick) : 1.0 - frame.y.place(tick);
    rows += format("<span style=\"top:%.2f%%\">%s</span>", 100.0 * top, tick_text(tick, frame.y.logarithmic).c_str());
    grid += format("<path class=grid d=\"M0 %.1fH1000\"/>", 1000.0 * top);
  }
  for (const double tick : frame.x.ticks(4)) {
    const double left = frame.x.place(tick);
    columns +=
        format("<span style=\"left:%.2f%%\">%s</span>", 100.0 * left, tick_text(tick, frame.x.logarithmic).c_str());
    grid += format("<path class=grid d=\"M%.1f 0V1000\"/>", 1000.0 * left);
  }
  return "<div class=ylabel>" + frame.y_label + "</div><div class=area style=\"height:" + frame.height +
         "\"><div class=yticks>" + rows +
         "</div><svg viewBox=\"0 0 1000 1000\" preserveAspectRatio=\"none\" aria-hidden=true>" + grid + inside +
         "</svg></div><div class=xticks>" + columns + "</div><div class=xlabel>" + frame.x_label + "</div>";
}

std::string line_plot(const std::vector<Series>& series, const PlotText& text, const PlotScale& scale) {
  std::vector<double> xs;
  std::vector<double> ys;
  std::vector<std::vector<Point>> points;
  bool any = false;
  for (const Series& one : series) {
    points.push_back(points_of(*one.curve, scale));
    any = any || points.back().size() > 1;
    for (const Point& point : points.back()) {
      xs.push_back(point.x);
      ys.push_back(point.y);
    }
  }
  if (!any) return {};
  Axis x = axis_around(xs, scale.logarithmic);
  if (!scale.logarithmic) {
    x.low = *std::ranges::min_element(xs);
    x.high = std::max(*std::ranges::max_element(xs), x.low + 1e-9);
  }
  Axis y = axis_around(ys, scale.logarithmic);
  if (scale.least_reach > 0.0) {
    y.low = std::min(y.low, -scale.least_reach);
    y.high = std::max(y.high, scale.least_reach);
  }
  std::string inside;
  if (!scale.logarithmic && y.low < 0.0 && y.high > 0.0) {
    const double zero = 1000.0 * y.place(0.0);
    inside += scale.sideways ? format("<path class=zero d=\"M%.1f 0V1000\"/>", zero)
                             : format("<path class=zero d=\"M0 %.1fH1000\"/>", 1000.0 - zero);
  }
  std::vector<Series> drawn;
  for (std::size_t i = 0; i < series.size(); ++i) {
    if (points[i].size() < 2) continue;
    inside += format("<path class=\"line %s%s\" d=\"%s\"/>", series[i].look, series[i].dots ? " dots" : "",
                     path_of(points[i], x, y, scale.sideways, series[i].dots).c_str());
    drawn.push_back(series[i]);
  }
  const Frame frame =
      scale.sideways ? Frame{y, x, true, text.y, text.x, "190px"} : Frame{x, y, false, text.x, text.y, "190px"};
  return "<figure class=plot><h4>" + text.title + "</h4>" + legend(drawn) + framed(frame, inside) + "<figcaption>" +
         text.caption + "</figcaption></figure>";
}

}  // namespace bolo::diagnose
