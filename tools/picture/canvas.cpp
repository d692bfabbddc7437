#include "tools/picture/canvas.hpp"

#include <cairo.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

namespace bolo::tools {
namespace {

constexpr const char* kFont = "DejaVu Sans";
constexpr double kTickLength = 4.0;
constexpr double kTickText = 11.0;

struct SurfaceDelete {
  void operator()(cairo_surface_t* s) const { cairo_surface_destroy(s); }
};
struct ContextDelete {
  void operator()(cairo_t* c) const { cairo_destroy(c); }
};

// The round step (1, 2 or 5 times a power of ten) that cuts the span into about `wanted` parts.
double tick_step(double span, int wanted) {
  const double raw = span / wanted;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  const double part = raw / power;
  return power * (part < 1.5 ? 1.0 : part < 3.5 ? 2.0 : part < 7.5 ? 5.0 : 10.0);
}

std::string number(double value, double step) {
  char buffer[32];
  const int digits = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  std::snprintf(buffer, sizeof buffer, "%.*f", digits, std::abs(value) < step * 1e-6 ? 0.0 : value);
  return buffer;
}

double place(double value, const Axis& axis, double from, double length) {
  return from + (value - axis.low) / (axis.high - axis.low) * length;
}

}  // namespace

struct Canvas::Impl {
  std::unique_ptr<cairo_surface_t, SurfaceDelete> surface;
  std::unique_ptr<cairo_t, ContextDelete> context;

  void colour(Colour c) const { cairo_set_source_rgb(context.get(), c.red, c.green, c.blue); }
  void line(double x0, double y0, double x1, double y1) const {
    cairo_move_to(context.get(), x0, y0);
    cairo_line_to(context.get(), x1, y1);
    cairo_stroke(context.get());
  }
};

Canvas::Canvas(int width, int height) : impl_(std::make_unique<Impl>()) {
  impl_->surface.reset(cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, height));
  impl_->context.reset(cairo_create(impl_->surface.get()));
  impl_->colour(kPaper);
  cairo_paint(impl_->context.get());
}
Canvas::~Canvas() = default;
Canvas::Canvas(Canvas&&) noexcept = default;
Canvas& Canvas::operator=(Canvas&&) noexcept = default;

void Canvas::text(double x, double y, const std::string& words, const TextStyle& style) {
  cairo_t* c = impl_->context.get();
  cairo_select_font_face(c, kFont, CAIRO_FONT_SLANT_NORMAL,
                         style.bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(c, style.size);
  cairo_text_extents_t extents;
  cairo_text_extents(c, words.c_str(), &extents);
  if (style.align == Align::kCentre) x -= extents.x_advance / 2;
  if (style.align == Align::kRight) x -= extents.x_advance;
  impl_->colour(style.colour);
  cairo_move_to(c, x, y);
  cairo_show_text(c, words.c_str());
}

void Canvas::thermal(const Box& where, std::span<const float> image, Geometry geometry, Region region,
                     TemperatureRange range, Palette palette) {
  std::unique_ptr<cairo_surface_t, SurfaceDelete> picture(
      cairo_image_surface_create(CAIRO_FORMAT_RGB24, region.width, region.height));
  const auto stride = static_cast<std::size_t>(cairo_image_surface_get_stride(picture.get()));
  unsigned char* bytes = cairo_image_surface_get_data(picture.get());
  const double span = std::max(range.high - range.low, 1e-9);
  for (int y = 0; y < region.height; ++y) {
    auto* row = reinterpret_cast<std::uint32_t*>(bytes + static_cast<std::size_t>(y) * stride);
    const auto first = static_cast<std::size_t>(region.y + y) * static_cast<std::size_t>(geometry.width) +
                       static_cast<std::size_t>(region.x);
    for (int x = 0; x < region.width; ++x) {
      row[x] = colour_of(palette, (static_cast<double>(image[first + static_cast<std::size_t>(x)]) - range.low) / span);
    }
  }
  cairo_surface_mark_dirty(picture.get());
  cairo_t* c = impl_->context.get();
  cairo_save(c);
  cairo_translate(c, where.x, where.y);
  cairo_scale(c, where.width / region.width, where.height / region.height);
  cairo_set_source_surface(c, picture.get(), 0, 0);
  cairo_pattern_set_filter(cairo_get_source(c), CAIRO_FILTER_NEAREST);
  cairo_rectangle(c, 0, 0, region.width, region.height);
  cairo_fill(c);
  cairo_restore(c);
}

void Canvas::colour_bar(const Box& where, TemperatureRange range, const std::string& unit, Palette palette) {
  constexpr int kSteps = 256;
  std::vector<float> ramp(kSteps);
  for (int i = 0; i < kSteps; ++i) ramp[static_cast<std::size_t>(i)] = static_cast<float>(i) / (kSteps - 1);
  thermal(where, ramp, {kSteps, 1}, {0, 0, kSteps, 1}, {0.0, 1.0}, palette);
  const double base = where.y + where.height + kTickText + 3;
  const double step = tick_step(range.high - range.low, 5);
  for (double v = std::ceil(range.low / step) * step; v <= range.high; v += step) {
    text(place(v, {range.low, range.high, ""}, where.x, where.width), base, number(v, step),
         {kTickText, false, kInk, Align::kCentre});
  }
  text(where.x + where.width + 14, where.y + where.height - 2, unit, {kTickText});
}

void Canvas::rectangle(const Box& where, Colour colour, double line_width) {
  impl_->colour(colour);
  cairo_set_line_width(impl_->context.get(), line_width);
  cairo_rectangle(impl_->context.get(), where.x, where.y, where.width, where.height);
  cairo_stroke(impl_->context.get());
}

void Canvas::fill(const Box& where, Colour colour) {
  impl_->colour(colour);
  cairo_rectangle(impl_->context.get(), where.x, where.y, where.width, where.height);
  cairo_fill(impl_->context.get());
}

void Canvas::line(double from_x, double from_y, double to_x, double to_y, Colour colour, double line_width) {
  impl_->colour(colour);
  cairo_set_line_width(impl_->context.get(), line_width);
  impl_->line(from_x, from_y, to_x, to_y);
}

void Canvas::disc(double x, double y, double radius, Colour colour) {
  constexpr double kFullTurn = 6.283185307179586;
  impl_->colour(colour);
  cairo_new_sub_path(impl_->context.get());
  cairo_arc(impl_->context.get(), x, y, radius, 0.0, kFullTurn);
  cairo_fill(impl_->context.get());
}

void Canvas::axes(const Box& where, const Axis& x, const Axis& y) {
  const double bottom = where.y + where.height;
  cairo_set_line_width(impl_->context.get(), 1.0);
  const double x_step = tick_step(x.high - x.low, 8);
  for (double v = std::ceil(x.low / x_step) * x_step; v <= x.high + 1e-9; v += x_step) {
    const double at = place(v, x, where.x, where.width);
    impl_->colour(kFaint);
    impl_->line(at, bottom, at, bottom + kTickLength);
    text(at, bottom + kTickLength + kTickText + 2, number(v, x_step), {kTickText, false, kInk, Align::kCentre});
  }
  const double y_step = tick_step(y.high - y.low, 5);
  for (double v = std::ceil(y.low / y_step) * y_step; v <= y.high + 1e-9; v += y_step) {
    const double at = place(v, y, bottom, -where.height);
    impl_->colour({0.9, 0.9, 0.92});
    impl_->line(where.x, at, where.x + where.width, at);
    text(where.x - 6, at + 4, number(v, y_step), {kTickText, false, kInk, Align::kRight});
  }
  rectangle(where, kFaint, 1.0);
  text(where.x + where.width / 2, bottom + 34, x.label, {12.0, false, kInk, Align::kCentre});
  text(where.x, where.y - 8, y.label, {12.0});
}

void Canvas::curve(const Box& where, const Axis& x, const Axis& y, std::span<const double> xs,
                   std::span<const double> ys, Colour colour, double line_width) {
  cairo_t* c = impl_->context.get();
  cairo_save(c);
  cairo_rectangle(c, where.x, where.y, where.width, where.height);
  cairo_clip(c);
  cairo_set_line_width(c, line_width);
  cairo_set_line_join(c, CAIRO_LINE_JOIN_ROUND);
  impl_->colour(colour);
  bool pen_down = false;
  for (std::size_t i = 0; i < std::min(xs.size(), ys.size()); ++i) {
    if (std::isnan(ys[i])) {
      pen_down = false;
      continue;
    }
    const double px = place(xs[i], x, where.x, where.width);
    const double py = place(ys[i], y, where.y + where.height, -where.height);
    pen_down ? cairo_line_to(c, px, py) : cairo_move_to(c, px, py);
    pen_down = true;
  }
  cairo_stroke(c);
  cairo_restore(c);
}

Status Canvas::save(const std::string& file) const {
  const cairo_status_t status = cairo_surface_write_to_png(impl_->surface.get(), file.c_str());
  if (status == CAIRO_STATUS_SUCCESS) return {};
  return bad_input(file + ": cannot write the picture: " + cairo_status_to_string(status));
}

}  // namespace bolo::tools
