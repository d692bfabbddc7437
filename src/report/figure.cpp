// Whole drawings: plots with titles and captions, stacked or side by side.
#include <algorithm>
#include <cmath>
#include <map>

#include "page_text.hpp"  // page.css: one column of readable width, light and dark by the reader's preference
#include "src/report/drawing.hpp"
#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

// --- Style of drawings and pages. Each class has literal colours: SVG viewers other than browsers know neither
// variables nor the reader's preference, and show the light ones.

std::string hex(Rgb rgb) { return format("#%02x%02x%02x", rgb.red, rgb.green, rgb.blue); }

std::string hues(bool dark) {
  std::string out;
  for (std::size_t i = 0; i < kHues; ++i) {
    const HueColours& hue = colours_of(static_cast<Hue>(i));
    const std::string colour = hex(dark ? hue.on_dark : hue.on_light);
    out += format(".bolo-plot .s-%s{stroke:%s}.bolo-plot .f-%s{fill:%s}\n", hue.name, colour.c_str(), hue.name,
                  colour.c_str());
  }
  return out;
}

constexpr const char* kShapes = R"(
.bolo-plot{font:12px system-ui,-apple-system,"Segoe UI","DejaVu Sans",sans-serif}
.bolo-plot .paper{fill:#ffffff}.bolo-plot text{fill:#1a212d}
.bolo-plot .tick,.bolo-plot .key,.bolo-plot .caption{fill:#566072}
.bolo-plot .title{font-size:15px;font-weight:600}.bolo-plot .heading{font-size:18px;font-weight:650}
.bolo-plot .caption{font-size:13px}
.bolo-plot .end{text-anchor:end}.bolo-plot .middle{text-anchor:middle}
.bolo-plot path{fill:none}.bolo-plot .grid{stroke:#e3e7ee}.bolo-plot .axis{stroke:#8a93a3}
.bolo-plot .line{stroke-linejoin:round;stroke-linecap:round}.bolo-plot .dashed{stroke-dasharray:6 4;stroke-linecap:butt}
.bolo-plot .mark{stroke-width:1;stroke-opacity:.6}.bolo-plot .level{stroke-width:1.2;stroke-dasharray:3 3}
.bolo-plot .lead{stroke-width:.8}.bolo-plot .plane{image-rendering:pixelated}
)";

constexpr const char* kDarkShapes =
    ".bolo-plot .paper{fill:#10141a}.bolo-plot text{fill:#e5e9f0}.bolo-plot .tick,.bolo-plot .key,.bolo-plot .caption"
    "{fill:#9ba6b7}.bolo-plot .grid{stroke:#262e3a}.bolo-plot .axis{stroke:#6b7585}\n";

// Follows the hues, which would fill it otherwise.
constexpr const char* kBand = ".bolo-plot path.band{fill-opacity:.22}.bolo-plot rect.band{fill-opacity:.35}\n";

constexpr double kEdge = 16.0;     // px, around everything
constexpr double kBetween = 26.0;  // px, between plots
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

// Left and right margins common to all plots.
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

// Title and caption are HTML outside the drawing; `sides`: margins of its area.
std::string figure(const Plot& plot, const Margins& sides) {
  constexpr double kBroad = 600.0;  // px; on a phone, broader plots are scrolled instead of shrunk beyond legibility
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

const std::string& plot_style() {
  static const std::string style =
      kShapes + hues(false) + kBand + "@media(prefers-color-scheme:dark){\n" + kDarkShapes + hues(true) + "}\n";
  return style;
}

std::string page_html(const std::string& title, const std::string& body, const std::string& style) {
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/><meta name=\"viewport\" "
         "content=\"width=device-width,initial-scale=1\"/><title>" +
         escaped(title) + "</title><style>" + kPageStyle + plot_style() + style + "</style></head><body><main>\n" +
         body + "</main></body></html>\n";
}

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
  std::map<std::pair<std::size_t, std::size_t>, std::vector<const Plot*>> columns;  // by length of row, and index
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

namespace {

bool is_number(const std::string& cell) {
  std::size_t at = 0;
  for (const std::string& sign : {std::string("+"), std::string("-"), std::string("\u2212"), std::string("< ")}) {
    if (cell.starts_with(sign)) at = sign.size();
  }
  return at < cell.size() && cell[at] >= '0' && cell[at] <= '9';
}

// True for columns that are mostly numbers, which are aligned to the right.
std::vector<bool> number_columns(const Table& table) {
  std::vector<bool> out(table.head.size());
  for (std::size_t c = 0; c < out.size(); ++c) {
    const auto numbers = std::ranges::count_if(
        table.rows, [c](const std::vector<std::string>& row) { return c < row.size() && is_number(row[c]); });
    out[c] = 2 * static_cast<std::size_t>(numbers) > table.rows.size();
  }
  return out;
}

std::string table_html(const Table& table) {
  const std::vector<bool> numbers = number_columns(table);
  const auto cells = [&](const char* tag, const std::vector<std::string>& row) {
    std::string out = "<tr>";
    for (std::size_t c = 0; c < row.size(); ++c) {
      const bool number = c < numbers.size() && numbers[c];
      out += format("<%s%s>", tag, number ? " class=\"n\"" : "") + escaped(row[c]) + "</" + tag + ">";
    }
    return out + "</tr>\n";
  };
  std::string body = "<div class=\"scroll\"><table>";
  if (!table.caption.empty()) body += "<caption>" + escaped(table.caption) + "</caption>";
  body += cells("th", table.head);
  for (const auto& row : table.rows) body += cells("td", row);
  return body + "</table></div>\n";
}

std::string page_of(const Sheet& sheet) {
  std::string body;
  std::vector<Plot> stack;  // consecutive rows of one plot are aligned
  for (const std::vector<Plot>& row : sheet.rows) {
    if (row.size() == 1) {
      stack.push_back(row.front());
      continue;
    }
    body += aligned_figures_html(std::exchange(stack, {})) + "<div class=\"plots\">";
    for (const Plot& one : row) body += figure_html(one);
    body += "</div>\n";
  }
  body += aligned_figures_html(stack);
  for (const Table& table : sheet.tables) body += table_html(table);
  if (!sheet.how.empty()) {
    body += "<h2>How it was measured</h2>\n<p class=\"soft\">" + escaped(sheet.how) + "</p>\n";
  }
  return page_html(sheet.title, "<h1>" + escaped(sheet.title) + "</h1>\n" + body);
}

}  // namespace

Status check_sheet_file(const std::filesystem::path& file) {
  if (file.extension() == ".svg" || file.extension() == ".html") return {};
  return bad_input(file.string() + ": a plot is written as .svg or .html");
}

Status save(const Sheet& sheet, const OutputFile& file) {
  if (Status good = check_sheet_file(file.path); !good) return good;
  if (file.path.extension() == ".html") return write_file(file, page_of(sheet));
  Rows drawn = sheet.rows;
  for (std::vector<Plot>& row : drawn) std::erase_if(row, [](const Plot& plot) { return !has_content(plot); });
  return write_file(file, to_svg(drawn, sheet.title));
}

}  // namespace bolo::plot
