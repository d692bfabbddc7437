// Words and numbers of plots and pages.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace bolo::plot {

// printf into a string. Thread: any.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

// Text as HTML and SVG show it; bytes that are no UTF-8 become question marks. Thread: any.
std::string escaped(std::string_view text);

// Three significant digits, without an exponent between 0.001 and 99999; with `powers`, for a logarithmic axis, between
// 0.01 and 9999: 10⁻⁶, 2·10⁵. Thread: any.
std::string number_text(double value, bool powers = false);

// Numbers keep their units on the same line. Thread: any.
std::string unbroken(std::string text);

// About how wide a text is in the sans-serif letters of any system, in pixels: rather too wide than too narrow.
// Thread: any.
double text_width(std::string_view text, double size);

// Lines of at most `width` pixels, cut at blanks. Thread: any.
std::vector<std::string> wrapped(std::string_view text, double size, double width);

}  // namespace bolo::plot
