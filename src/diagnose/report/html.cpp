#include "src/diagnose/report/html.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>

namespace bolo::diagnose {
namespace {

// Bytes of the character that begins with `lead`; 0 when none does.
std::size_t utf8_length(unsigned char lead) {
  if (lead < 0x80) return 1;
  if (lead >= 0xC2 && lead < 0xE0) return 2;
  if (lead >= 0xE0 && lead < 0xF0) return 3;
  return lead >= 0xF0 && lead < 0xF5 ? 4 : 0;
}

// Whether the bytes after the first of `length` are those of a character.
bool continues(const std::string& text, std::size_t at, std::size_t length) {
  if (length == 0 || at + length > text.size()) return false;
  for (std::size_t i = 1; i < length; ++i) {
    if ((static_cast<unsigned char>(text[at + i]) & 0xC0U) != 0x80U) return false;
  }
  return true;
}

std::vector<double> linear_ticks(double low, double high, int wanted) {
  const double rough = (high - low) / std::max(1, wanted);
  const double decade = std::pow(10.0, std::floor(std::log10(rough)));
  double step = 10.0 * decade;
  for (const double factor : {5.0, 2.0, 1.0}) {
    if (factor * decade >= rough) step = factor * decade;
  }
  std::vector<double> out;
  for (double i = std::ceil(low / step); i * step <= high + 1e-9 * step; i += 1.0) out.push_back(i * step);
  return out;
}

// 1, 2 and 5 of each decade; only the decades, or each second one and so on, when there are many.
std::vector<double> log_ticks(double low, double high, int wanted) {
  std::vector<double> out;
  const double decades = std::log10(high / low);
  const bool fine = 3.0 * decades <= wanted + 1.0;
  const double stride = std::max(1.0, std::ceil(decades / std::max(1, wanted)));
  for (double e = std::floor(std::log10(low)); e <= std::log10(high); e += fine ? 1.0 : stride) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double value = factor * std::pow(10.0, e);
      if ((fine || factor == 1.0) && value >= low * (1.0 - 1e-9) && value <= high * (1.0 + 1e-9)) out.push_back(value);
    }
  }
  return out;
}

}  // namespace

std::string format(const char* pattern, ...) {
  std::va_list values;
  va_start(values, pattern);
  std::va_list again;
  va_copy(again, values);
  const int size = std::vsnprintf(nullptr, 0, pattern, values);
  std::string out(static_cast<std::size_t>(std::max(0, size)), '\0');
  std::vsnprintf(out.data(), out.size() + 1, pattern, again);
  va_end(again);
  va_end(values);
  return out;
}

std::string escaped(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = utf8_length(static_cast<unsigned char>(text[i]));
    if (!continues(text, i, length)) {
      out += '?';
      ++i;
      continue;
    }
    const std::string one = text.substr(i, length);
    out += one == "<" ? "&lt;" : one == ">" ? "&gt;" : one == "&" ? "&amp;" : one == "\"" ? "&quot;" : one;
    i += length;
  }
  return out;
}

std::string tick_text(double value, bool powers) {
  const double size = std::abs(value);
  if (size < 1e-12) return "0";
  if (size >= (powers ? 0.99e4 : 1e5) || size < (powers ? 0.99e-2 : 1e-3)) {
    // 1e-06 reads better as 10 to a power.
    const double exponent = std::floor(std::log10(size) + 1e-9);
    const double mantissa = value / std::pow(10.0, exponent);
    std::string power = format("10<sup>%s%.0f</sup>", exponent < 0 ? "\u2212" : "", std::abs(exponent));
    if (std::abs(mantissa - 1.0) < 1e-6) return power;
    return format("%.3g\u00b7", mantissa) + power;
  }
  std::string text = size >= 999.5 ? format("%.0f", value) : format("%.3g", value);
  if (value < 0.0) text.replace(0, 1, "\u2212");
  return text;
}

std::string unbroken(std::string text) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  for (std::size_t i = text.size(); i-- > 2;) {
    const bool unit = text[i] == '%' || text.compare(i, 2, "\u00b5") == 0 || text.compare(i, 2, "mK") == 0 ||
                      text.compare(i, 2, "ms") == 0 || text.compare(i, 2, "s ") == 0 || text.compare(i, 2, "Hz") == 0 ||
                      text.compare(i, 2, "px") == 0 || text.compare(i, 2, "K ") == 0;
    if (unit && text[i - 1] == ' ' && is_digit(text[i - 2])) text.replace(i - 1, 1, "\u00a0");
  }
  return text;
}

double Axis::place(double value) const {
  const double share =
      logarithmic ? std::log(std::max(value, 1e-300) / low) / std::log(high / low) : (value - low) / (high - low);
  return std::clamp(share, -0.05, 1.05);
}

std::vector<double> Axis::ticks(int wanted) const {
  return logarithmic ? log_ticks(low, high, wanted) : linear_ticks(low, high, wanted);
}

Axis axis_around(const std::vector<double>& values, bool logarithmic) {
  Axis axis{0.0, 0.0, logarithmic};
  bool any = false;
  for (const double value : values) {
    if (!std::isfinite(value) || (logarithmic && value <= 0.0)) continue;
    axis.low = any ? std::min(axis.low, value) : value;
    axis.high = any ? std::max(axis.high, value) : value;
    any = true;
  }
  if (!any) return logarithmic ? Axis{0.1, 10.0, true} : Axis{};
  if (logarithmic) {
    const double margin = std::max(1.2, std::pow(axis.high / axis.low, 0.05));
    return {axis.low / margin, axis.high * margin, true};
  }
  const double margin = axis.high > axis.low ? 0.06 * (axis.high - axis.low) : std::max(1e-6, 0.1 * std::abs(axis.low));
  return {axis.low - margin, axis.high + margin, false};
}

}  // namespace bolo::diagnose
