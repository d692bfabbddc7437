#include "src/report/drawing.hpp"

#include <algorithm>
#include <cmath>

#include "src/core/statistics.hpp"
#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

constexpr double kText = 12.0;     // px, of ticks and names
constexpr double kLine = 17.0;     // px, line height
constexpr double kEndGap = 15.0;   // px, between curve names
constexpr double kNameRise = 9.0;  // px, of the upright axis' name above the area
constexpr double kKey = 22.0;      // px, sample of a legend entry
constexpr double kKeyGap = 18.0;   // px, between legend entries
constexpr double kRampWidth = 130.0;

std::string label_of(const Axis& axis) {
  return axis.unit.empty() ? axis.name : axis.name.empty() ? axis.unit : axis.name + ", " + axis.unit;
}

bool is_curve(const Series& series) { return series.kind == Kind::kLine; }

std::vector<double> values_of_x(const Plot& plot) {
  std::vector<double> values;
  for (const Series& series : plot.series) values.insert(values.end(), series.x.begin(), series.x.end());
  if (plot.plane.width > 0) values.insert(values.end(), {-0.5, plot.plane.width - 0.5});
  return values;
}

std::vector<double> values_of_y(const Plot& plot) {
  std::vector<double> values;
  for (const Series& series : plot.series) {
    values.insert(values.end(), series.y.begin(), series.y.end());
    if (series.kind == Kind::kBand) values.insert(values.end(), series.to.begin(), series.to.end());
  }
  for (const Level& level : plot.levels) values.push_back(level.at);
  if (plot.plane.height > 0) values.insert(values.end(), {-0.5, plot.plane.height - 0.5});
  return values;
}

// Points without curves keep a margin from the area's edges.
bool is_tight_in_x(const Plot& plot) {
  return plot.series.empty() ||
         !std::ranges::all_of(plot.series, [](const Series& s) { return s.kind == Kind::kPoints; });
}

std::string text_at(const char* css_class, double x, double y, const std::string& words) {
  return format("<text class=\"%s\" x=\"%.1f\" y=\"%.1f\">", css_class, x, y) + escaped(words) + "</text>";
}

// Moves values apart to at least `gap`, by as little as possible, within 0 .. `most`.
void spread(std::vector<double>& sorted, double gap, double most) {
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    sorted[i] = std::max(sorted[i], i == 0 ? 0.0 : sorted[i - 1] + gap);
  }
  double limit = most;
  for (std::size_t i = sorted.size(); i-- > 0;) {
    sorted[i] = std::min(sorted[i], limit);
    limit = sorted[i] - gap;
  }
}

std::string sample(Kind kind, Hue hue, bool dashed) {
  const char* name = colours_of(hue).name;
  if (kind == Kind::kPoints) return format("<circle class=\"f-%s\" cx=\"8\" cy=\"-4\" r=\"3.6\"/>", name);
  if (kind == Kind::kLine) {
    return format("<path class=\"line s-%s%s\" stroke-width=\"2.5\" d=\"M0 -4H16\"/>", name, dashed ? " dashed" : "");
  }
  return format("<rect class=\"band f-%s\" x=\"2\" y=\"-10\" width=\"12\" height=\"12\"/>", name);
}

}  // namespace

PlotArea::PlotArea(const Plot& plot)
    : plot_(plot),
      x_(plot.x, values_of_x(plot), is_tight_in_x(plot)),
      y_(plot.y, values_of_y(plot), plot.plane.width > 0) {}

bool PlotArea::names_ends() const {
  const auto curves = static_cast<double>(
      std::ranges::count_if(plot_.series, [](const Series& s) { return is_curve(s) && !s.label.empty(); }));
  return !plot_.sideways && kEndGap * (curves + static_cast<double>(plot_.levels.size())) <= plot_.height;
}

std::vector<PlotArea::Key> PlotArea::keyed() const {
  std::vector<Key> out;
  for (const Series& series : plot_.series) {
    const bool named = is_curve(series) && names_ends();
    if (!series.label.empty() && !named) out.push_back({series.label, series.kind, series.hue, series.dashed});
  }
  for (const Level& level : plot_.levels) {
    if (!level.label.empty() && !names_ends()) out.push_back({level.label, Kind::kLine, level.hue, true});
  }
  return out;
}

std::vector<std::vector<PlotArea::Key>> PlotArea::key_rows(double width) const {
  std::vector<std::vector<Key>> rows;
  double x = 0.0;
  for (const Key& key : keyed()) {
    const double wide = kKey + text_width(key.label, kText) + kKeyGap;
    if (rows.empty() || x + wide - kKeyGap > width) {
      rows.emplace_back();
      x = 0.0;
    }
    rows.back().push_back(key);
    x += wide;
  }
  return rows;
}

std::vector<Tick> PlotArea::ticks(const Scale& scale, int wanted) const {
  std::vector<Tick> ticks = scale.ticks(wanted);
  if (plot_.plane.width > 0) std::erase_if(ticks, [](const Tick& tick) { return tick.at != std::round(tick.at); });
  return ticks;
}

std::vector<Tick> PlotArea::upright_ticks() const {
  return ticks(upright_scale(), std::max(2, static_cast<int>(plot_.height / 42.0)));
}

// As many ticks as fit side by side without touching.
std::vector<Tick> PlotArea::across_ticks(double width) const {
  const Scale& scale = across_scale();
  for (int wanted = std::max(2, static_cast<int>(width / 70.0)); wanted > 1; --wanted) {
    std::vector<Tick> found = ticks(scale, wanted);
    double last = -1e9;
    bool touching = false;
    for (const Tick& tick : found) {
      const double half = text_width(tick.text, kText) / 2;
      const double middle = scale.place(tick.at) * width;
      touching = touching || middle - half < last + 8.0;
      last = middle + half;
    }
    if (!touching) return found;
  }
  return ticks(scale, 1);
}

Placing PlotArea::placing(const Margins& margins) const {
  return {x_,
          y_,
          plot_.width - margins.left - margins.right,
          plot_.height,
          plot_.sideways,
          plot_.sideways || plot_.plane.height > 0};
}

Margins PlotArea::needed() const {
  Margins margins{14.0, 14.0, 8.0, 24.0};
  for (const Tick& tick : upright_ticks()) margins.left = std::max(margins.left, text_width(tick.text, kText) + 10.0);
  const auto room_for = [&](const std::string& words) {
    margins.right = std::max(margins.right, text_width(words, kText) + 16.0);
  };
  if (names_ends()) {
    for (const Series& series : plot_.series) {
      if (is_curve(series)) room_for(series.label);
    }
    for (const Level& level : plot_.levels) room_for(level.label);
  }
  if (!label_of(across()).empty()) margins.bottom += kLine;
  if (!label_of(upright()).empty() || plot_.plane.width > 0) margins.top += kLine + 2.0;
  margins.top += kLine * static_cast<double>(key_rows(plot_.width - margins.left).size());
  return margins;
}

std::vector<PlotArea::EndLabel> PlotArea::end_labels(const Placing& placing) const {
  std::vector<EndLabel> labels;
  if (!names_ends()) return labels;
  const auto add = [&](Point end, const std::string& text, Hue hue) {
    if (!text.empty() && std::isfinite(end.y)) {
      labels.push_back({std::clamp(end.y, 0.0, placing.height), std::min(end.x, placing.width), text, hue});
    }
  };
  for (const Series& series : plot_.series) {
    if (is_curve(series)) add(end_of(series, placing), series.label, series.hue);
  }
  for (const Level& level : plot_.levels) add(placing.at(x_.high(), level.at), level.label, level.hue);
  std::ranges::stable_sort(labels, {}, &EndLabel::y);
  return labels;
}

std::string PlotArea::grid(const Placing& placing) const {
  std::string path;
  const Scale& down = upright_scale();
  for (const Tick& tick : upright_ticks()) {
    const double place = down.place(tick.at);
    path += format("M0 %.1fH%.1f", (placing.down ? place : 1.0 - place) * placing.height, placing.width);
  }
  for (const Tick& tick : across_ticks(placing.width)) {
    path += format("M%.1f 0V%.1f", across_scale().place(tick.at) * placing.width, placing.height);
  }
  return plot_.plane.width > 0 ? std::string() : "<path class=\"grid\" d=\"" + path + "\"/>";
}

std::string PlotArea::inside(const Placing& placing) const {
  std::string out = plane_svg(plot_.plane, placing);
  for (const double mark : plot_.marks) {
    const Point a = placing.at(mark, y_.low());
    const Point b = placing.at(mark, y_.high());
    if (!std::isfinite(a.x + a.y + b.x + b.y)) continue;
    out += format("<path class=\"mark s-soft\" d=\"M%.1f %.1fL%.1f %.1f\"/>", a.x, a.y, b.x, b.y);
  }
  for (const Level& level : plot_.levels) {
    const Point a = placing.at(x_.low(), level.at);
    const Point b = placing.at(x_.high(), level.at);
    if (!std::isfinite(a.x + a.y + b.x + b.y)) continue;
    out += format("<path class=\"level s-%s\" d=\"M%.1f %.1fL%.1f %.1f\"/>", colours_of(level.hue).name, a.x, a.y, b.x,
                  b.y);
  }
  for (const Series& series : plot_.series) out += series_svg(series, placing);
  return out;
}

std::string PlotArea::axis_text(const Margins& margins, const Placing& placing) const {
  std::string out;
  const double bottom = margins.top + placing.height;
  for (const Tick& tick : upright_ticks()) {
    const double place = upright_scale().place(tick.at);
    const double y = margins.top + (placing.down ? place : 1.0 - place) * placing.height;
    out += text_at("tick end", margins.left - 7.0, y + 4.0, tick.text);
  }
  for (const Tick& tick : across_ticks(placing.width)) {
    out +=
        text_at("tick middle", margins.left + across_scale().place(tick.at) * placing.width, bottom + 17.0, tick.text);
  }
  if (const std::string name = label_of(across()); !name.empty()) {
    out += text_at("name middle", margins.left + placing.width / 2, bottom + 17.0 + kLine, name);
  }
  if (const std::string name = label_of(upright()); !name.empty()) {
    out += text_at("name", std::max(2.0, margins.left - 30.0), margins.top - kNameRise, name);
  }
  return out + format("<path class=\"axis\" d=\"M%.1f %.1fV%.1fH%.1f\"/>", margins.left, margins.top, bottom,
                      margins.left + placing.width);
}

std::string PlotArea::keys(const Margins& margins) const {
  std::string out;
  double y = 12.0;
  for (const auto& row : key_rows(plot_.width - margins.left)) {
    double x = margins.left;
    for (const Key& key : row) {
      out += format("<g transform=\"translate(%.1f %.1f)\">", x, y) + sample(key.kind, key.hue, key.dashed) + "</g>";
      out += text_at("key", x + kKey, y, key.label);
      x += kKey + text_width(key.label, kText) + kKeyGap;
    }
    y += kLine;
  }
  return out;
}

// The plane's colour ramp with the values of its ends, above the area at the right.
std::string PlotArea::ramp(const Margins& margins, const Placing& placing) const {
  if (plot_.plane.width < 1) return {};
  const PlaneSpan span = span_of(plot_.plane);
  const std::string high = number_text(span.high) + (plot_.plane.unit.empty() ? "" : " " + plot_.plane.unit);
  const double right = margins.left + placing.width;
  const double left = right - text_width(high, kText) - 6.0 - kRampWidth;
  const double y = margins.top - kNameRise;
  std::string out = text_at("tick end", left - 6.0, y, number_text(span.low)) + text_at("tick end", right, y, high);
  constexpr int kParts = 26;
  for (int i = 0; i < kParts; ++i) {
    const Rgb rgb = colour_at(plot_.plane.ramp, (i + 0.5) / kParts);
    out += format("<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"9\" fill=\"#%02x%02x%02x\"/>",
                  left + i * kRampWidth / kParts, y - 9.0, kRampWidth / kParts + 0.4, rgb.red, rgb.green, rgb.blue);
  }
  return out;
}

std::string PlotArea::ends(const Margins& margins, const Placing& placing) const {
  const std::vector<EndLabel> labels = end_labels(placing);
  std::vector<double> ys = mapped(labels, &EndLabel::y);
  spread(ys, kEndGap, placing.height);
  std::string out;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const EndLabel& label = labels[i];
    const double x = margins.left + placing.width;
    const double y = margins.top + ys[i];
    if (std::abs(ys[i] - label.y) > 4.0 || placing.width - label.from_x > 12.0) {
      out += format("<path class=\"lead s-%s\" d=\"M%.1f %.1fL%.1f %.1f\"/>", colours_of(label.hue).name,
                    margins.left + label.from_x + 2.0, margins.top + label.y, x + 6.0, y);
    }
    out += format("<text class=\"name f-%s\" x=\"%.1f\" y=\"%.1f\">", colours_of(label.hue).name, x + 8.0, y + 4.0) +
           escaped(label.text) + "</text>";
  }
  return out;
}

std::string PlotArea::drawing(const Margins& margins) const {
  const Placing placed = placing(margins);
  return keys(margins) + ramp(margins, placed) +
         format("<svg x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\">", margins.left, margins.top, placed.width,
                placed.height) +
         grid(placed) + inside(placed) + "</svg>" + axis_text(margins, placed) + ends(margins, placed);
}

}  // namespace bolo::plot
