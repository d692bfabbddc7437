// Whole drawings: plots with titles and captions, one below the other or beside each other.
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "src/report/data_picture.hpp"
#include "src/report/plot.hpp"
#include "src/report/plot_area.hpp"
#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

constexpr double kEdge = 16.0;     // px, around everything
constexpr double kBetween = 26.0;  // px, from plot to plot
constexpr double kTitle = 24.0;
constexpr double kCaptionSize = 13.0;
constexpr double kCaptionLine = 18.0;
constexpr double kHeading = 30.0;

constexpr const char* kOfAFile = " xmlns=\"http://www.w3.org/2000/svg\" class=\"bolo-plot\"";
constexpr const char* kInAPage = " class=\"bolo-plot\"";

std::string svg_head(const char* as_what, double width, double height, const std::string& name) {
  return format("<svg%s viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" height=\"%.0f\" role=\"img\" aria-label=\"", as_what,
                width, height, width, height) +
         escaped(name) + "\">";
}

std::vector<std::string> caption_lines(const Plot& plot) { return wrapped(plot.caption, kCaptionSize, plot.width); }

double head_height(const Plot& plot) {
  return (plot.title.empty() ? 0.0 : kTitle) + kCaptionLine * static_cast<double>(caption_lines(plot).size()) +
         (plot.caption.empty() ? 0.0 : 8.0);
}

// Title and caption stand above the plot: they say what to look for.
std::string head_of(const Plot& plot) {
  std::string out;
  double y = 15.0;
  if (!plot.title.empty()) {
    out += format("<text class=\"title\" x=\"0\" y=\"%.1f\">", y) + escaped(plot.title) + "</text>";
    y += kTitle;
  }
  for (const std::string& line : caption_lines(plot)) {
    out += format("<text class=\"caption\" x=\"0\" y=\"%.1f\">", y - 4.0) + escaped(line) + "</text>";
    y += kCaptionLine;
  }
  return out;
}

// Left and right of all areas.
Margins common(const std::vector<const Plot*>& plots) {
  Margins all;
  for (const Plot* plot : plots) {
    const Margins one = PlotArea(*plot).needed();
    all.left = std::max(all.left, one.left);
    all.right = std::max(all.right, one.right);
  }
  return all;
}

Margins aligned(const PlotArea& area, const Margins& sides) {
  Margins margins = area.needed();
  margins.left = std::max(margins.left, sides.left);
  margins.right = std::max(margins.right, sides.right);
  return margins;
}

// Title and caption are the page's own words; `sides`: of the drawing's area.
std::string figure(const Plot& plot, const Margins& sides) {
  constexpr double kBroad = 600.0;  // px; broader plots are scrolled on a phone rather than made too small to read
  const PlotArea area(plot);
  const Margins margins = aligned(area, sides);
  std::string out = "<figure>";
  if (!plot.title.empty()) out += "<h4>" + escaped(plot.title) + "</h4>";
  if (!plot.caption.empty()) out += "<figcaption>" + escaped(plot.caption) + "</figcaption>";
  return out + "<div class=\"scroll\">" +
         svg_head(plot.width > kBroad ? " class=\"bolo-plot broad\"" : kInAPage, plot.width, area.height(margins),
                  plot.title) +
         area.drawing(margins) + "</svg></div></figure>\n";
}

}  // namespace

bool has_content(const Plot& plot) {
  if (!picture_address(plot.plane).empty()) return true;
  return std::ranges::any_of(plot.series, [](const Series& series) {
    for (std::size_t i = 0; i < std::min(series.x.size(), series.y.size()); ++i) {
      if (std::isfinite(series.x[i]) && std::isfinite(series.y[i])) return true;
    }
    return false;
  });
}

std::string figure_html(const Plot& plot) { return aligned_figures_html({&plot, 1}); }

std::string aligned_figures_html(std::span<const Plot> plots) {
  std::vector<const Plot*> drawn;
  for (const Plot& plot : plots) {
    if (has_content(plot)) drawn.push_back(&plot);
  }
  const Margins sides = common(drawn);
  std::string out;
  for (const Plot* plot : drawn) out += figure(*plot, sides);
  return out;
}

std::string to_svg(const Rows& rows, const std::string& heading) {
  std::map<std::pair<std::size_t, std::size_t>, std::vector<const Plot*>> columns;  // by plots in the row, and place
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) columns[{row.size(), i}].push_back(&row[i]);
  }
  std::string body;
  double width = 0.0;
  double y = kEdge + (heading.empty() ? 0.0 : kHeading);
  for (const auto& row : rows) {
    double x = kEdge;
    double head = 0.0;
    double height = 0.0;
    for (const Plot& plot : row) head = std::max(head, head_height(plot));
    for (std::size_t i = 0; i < row.size(); ++i) {
      const PlotArea area(row[i]);
      const Margins margins = aligned(area, common(columns[{row.size(), i}]));
      body += format("<g transform=\"translate(%.1f %.1f)\">", x, y) + head_of(row[i]) + "</g>";
      body += format("<g transform=\"translate(%.1f %.1f)\">", x, y + head) + area.drawing(margins) + "</g>";
      x += row[i].width + kBetween;
      height = std::max(height, area.height(margins));
    }
    width = std::max(width, x - kBetween + kEdge);
    if (!row.empty()) y += head + height + kBetween;
  }
  if (!heading.empty()) {
    body = format("<text class=\"heading\" x=\"%.1f\" y=\"%.1f\">", kEdge, kEdge + 14.0) + escaped(heading) +
           "</text>" + body;
  }
  const bool named = heading.empty() && !rows.empty() && !rows.front().empty();
  return svg_head(kOfAFile, width, y - kBetween + kEdge, named ? rows.front().front().title : heading) + "<style>" +
         plot_style() + "</style><rect class=\"paper\" width=\"100%\" height=\"100%\"/>" + body + "</svg>\n";
}

}  // namespace bolo::plot
