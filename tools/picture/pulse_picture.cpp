#include "tools/picture/pulse_picture.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "tools/picture/canvas.hpp"
#include "tools/picture/words.hpp"

namespace bolo::tools {
namespace {

constexpr double kLeft = 70.0;
constexpr double kWide = 1060.0;
constexpr double kClose = 0.35;  // s that the magnified part shows
constexpr Colour kBand{0.86, 0.90, 0.95};

struct Window {
  double from_s = 0.0;
  double to_s = 0.0;
};

// The part of the recording with the most switches.
Window closest(const diagnose::PulseFit& fit) {
  const double end_s = fit.trace.t_s.back();
  if (end_s <= kClose) return {0.0, end_s};
  Window best{0.0, kClose};
  long most = -1;
  for (const double at : fit.switches_s) {
    const double from_s = std::clamp(at - 0.02, 0.0, end_s - kClose);
    const auto inside =
        std::ranges::count_if(fit.switches_s, [&](double s) { return s >= from_s && s <= from_s + kClose - 0.05; });
    if (inside > most) {
      most = inside;
      best = {from_s, from_s + kClose};
    }
  }
  return best;
}

struct Scale {
  Box where;
  Axis x;
  Axis y;
  double px(double t) const { return where.x + (t - x.low) / (x.high - x.low) * where.width; }
  double py(double v) const { return where.y + where.height * (1.0 - (v - y.low) / (y.high - y.low)); }
};

void dots(Canvas& page, const Scale& scale, const std::vector<double>& t_s, const std::vector<double>& values,
          double radius, Colour colour) {
  for (std::size_t k = 0; k < t_s.size(); ++k) {
    if (std::isnan(values[k]) || t_s[k] < scale.x.low || t_s[k] > scale.x.high) continue;
    page.disc(scale.px(t_s[k]), scale.py(std::clamp(values[k], scale.y.low, scale.y.high)), radius, colour);
  }
}

Axis temperatures(const diagnose::PixelTrace& trace) {
  const auto [low, high] = std::ranges::minmax(trace.measured_k);
  const double margin = std::max(0.06 * (high - low), 1e-6);
  return {low - margin, high + margin, "K"};
}

void draw_signal(Canvas& page, const Scale& scale, const diagnose::PulseFit& fit, double radius) {
  page.axes(scale.where, scale.x, scale.y);
  for (const double at : fit.switches_s) {
    if (at < scale.x.low || at > scale.x.high) continue;
    page.line(scale.px(at), scale.where.y, scale.px(at), scale.where.y + scale.where.height, kFaint, 0.6);
  }
  page.curve(scale.where, scale.x, scale.y, fit.trace.fine_t_s, fit.trace.fine_k, kDeblurredColour, 1.8);
  dots(page, scale, fit.trace.t_s, fit.trace.measured_k, radius, kBlurredColour);
}

std::vector<double> residual_of(const diagnose::PixelTrace& trace) {
  std::vector<double> residual(trace.t_s.size());
  for (std::size_t k = 0; k < residual.size(); ++k) residual[k] = trace.measured_k[k] - trace.simulated_k[k];
  return residual;
}

void draw_residual(Canvas& page, const Scale& scale, const diagnose::PulseFit& fit, double noise_k) {
  const double low = std::max(scale.y.low, -2.0 * noise_k);
  const double high = std::min(scale.y.high, 2.0 * noise_k);
  page.fill({scale.where.x, scale.py(high), scale.where.width, scale.py(low) - scale.py(high)}, kBand);
  page.axes(scale.where, scale.x, scale.y);
  page.line(scale.px(scale.x.low), scale.py(0.0), scale.px(scale.x.high), scale.py(0.0), kInk, 0.8);
  dots(page, scale, fit.trace.t_s, residual_of(fit.trace), 1.8, kInk);
}

}  // namespace

Status draw_pulses(const std::string& file, const diagnose::PulseFit& fit, double noise_k) {
  if (fit.trace.t_s.size() < 2) return bad_input(file + ": no pixel of this fit can be drawn");
  Canvas page(1180, 880);
  page.text(kLeft, 32,
            words("One pixel (%d, %d): measured, and simulated with tau = %.3f ms", fit.trace.x, fit.trace.y,
                  1e3 * fit.trace.tau_s),
            {17.0, true});
  page.text(kLeft, 53,
            words("The frame's mean: %.4f ms (95 %%: %.4f to %.4f). %zu switches, found in the data. Residual %.4f K, "
                  "noise %.4f K.",
                  1e3 * fit.tau_s.value, 1e3 * fit.tau_s.low, 1e3 * fit.tau_s.high, fit.switches_s.size(), fit.rmse_k,
                  noise_k),
            {12.0});
  page.disc(kLeft + 6, 72, 3.0, kBlurredColour);
  page.text(kLeft + 16, 76, "measured", {12.0});
  page.line(kLeft + 100, 72, kLeft + 124, 72, kDeblurredColour, 2.0);
  page.text(kLeft + 130, 76, "simulated", {12.0});
  page.line(kLeft + 216, 66, kLeft + 216, 78, kFaint, 1.0);
  page.text(kLeft + 224, 76, "the input switches", {12.0});

  const double end_s = fit.trace.t_s.back();
  const Axis y = temperatures(fit.trace);
  draw_signal(page, {{kLeft, 110, kWide, 200}, {0.0, end_s, "time, s"}, y}, fit, 1.5);
  const Window close = closest(fit);
  draw_signal(page, {{kLeft, 385, kWide, 230}, {close.from_s, close.to_s, "time, s (magnified)"}, y}, fit, 3.0);

  double largest = 4.0 * noise_k;
  for (const double r : residual_of(fit.trace)) largest = std::isnan(r) ? largest : std::max(largest, std::abs(r));
  page.text(kLeft + kWide, 682, "blue band: twice the noise", {11.0, false, kInk, Align::kRight});
  draw_residual(
      page,
      {{kLeft, 690, kWide, 130}, {0.0, end_s, "time, s"}, {-1.1 * largest, 1.1 * largest, "measured - simulated, K"}},
      fit, noise_k);
  return page.save(file);
}

}  // namespace bolo::tools
