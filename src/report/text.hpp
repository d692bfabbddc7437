// Words and numbers of plots and pages.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace bolo::plot {

// printf into a string. Thread: any.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

// Escapes text for HTML and SVG; bytes that are not UTF-8 become question marks. Thread: any.
std::string escaped(std::string_view text);

// Three significant digits, without an exponent between 0.001 and 99999; with `powers`, for a logarithmic axis, between
// 0.01 and 9999: 10⁻⁶, 2·10⁵. Thread: any.
std::string number_text(double value, bool powers = false);

// Keeps numbers and their units on the same line. Thread: any.
std::string unbroken(std::string text);

// Approximate width in pixels of a text in any system's sans-serif font, rather too wide than too narrow. Thread: any.
double text_width(std::string_view text, double size);

// Splits at blanks into lines of at most `width` pixels. Thread: any.
std::vector<std::string> wrapped(std::string_view text, double size, double width);

}  // namespace bolo::plot
