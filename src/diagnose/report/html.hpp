// Pieces of a page: text, numbers, axes.
#pragma once

#include <string>
#include <vector>

namespace bolo::diagnose {

// printf into a string. Thread: any.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

// Text as HTML shows it; bytes that are no UTF-8 become question marks. Thread: any.
std::string escaped(const std::string& text);

// Three significant digits, without an exponent between 0.001 and 99999; with `powers`, for a logarithmic axis, between
// 0.01 and 9999. Thread: any.
std::string tick_text(double value, bool powers = false);

// Numbers keep their units on the same line. Thread: any.
std::string unbroken(std::string text);

// Where numbers come to stand: 0 at `low`, 1 at `high`, linear or in the logarithm.
struct Axis {
  double low = 0.0;
  double high = 1.0;
  bool logarithmic = false;

  double place(double value) const;
  std::vector<double> ticks(int wanted) const;
};

// An axis around all finite values (with `logarithmic`: all above zero), with a margin; never empty. Thread: any.
Axis axis_around(const std::vector<double>& values, bool logarithmic = false);

}  // namespace bolo::diagnose
