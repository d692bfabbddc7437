#include "src/report/text.hpp"

#include <cstdarg>

#include "src/core/text.hpp"

namespace bolo::plot {
namespace {

std::string superscript(int exponent) {
  constexpr std::array<const char*, 10> kDigits{"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                                                "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
  std::string out = exponent < 0 ? "\u207b" : "";
  for (const char digit : std::to_string(std::abs(exponent))) out += kDigits[static_cast<std::size_t>(digit - '0')];
  return out;
}

// Width in DejaVu Sans, the widest of the common fonts, in ems.
double letter_width(unsigned char c) {
  if (std::string_view("iljI.,:;'|! ").find(static_cast<char>(c)) != std::string_view::npos) return 0.34;
  if (std::string_view("frt()[]-/").find(static_cast<char>(c)) != std::string_view::npos) return 0.42;
  if (std::string_view("mwMW%@").find(static_cast<char>(c)) != std::string_view::npos) return 0.95;
  if (c >= 'A' && c <= 'Z') return 0.71;
  return 0.63;
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

std::string escaped(std::string_view text) {
  std::string out;
  while (!text.empty()) {
    const bool blank = text.front() == '\n' || text.front() == '\t';
    const std::size_t length = blank ? 1 : printable_character(text);
    const std::string_view one = length == 0 ? "?" : text.substr(0, length);
    text.remove_prefix(std::max<std::size_t>(1, length));
    out += one == "<" ? "&lt;" : one == ">" ? "&gt;" : one == "&" ? "&amp;" : one == "\"" ? "&quot;" : one;
  }
  return out;
}

std::string number_text(double value, bool powers) {
  const double size = std::abs(value);
  if (std::isnan(value)) return "\u2013";
  if (std::isinf(value)) return value < 0.0 ? "\u2212\u221e" : "\u221e";
  if (size < 1e-12) return "0";
  if (size >= (powers ? 0.99e4 : 1e5) || size < (powers ? 0.99e-2 : 1e-3)) {
    // A power of ten reads better than 1e-06.
    const double exponent = std::floor(std::log10(size) + 1e-9);
    const double mantissa = value / std::pow(10.0, exponent);
    const std::string power = "10" + superscript(static_cast<int>(exponent));
    return std::abs(mantissa - 1.0) < 1e-6 ? power : format("%.3g\u00b7", mantissa) + power;
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

double text_width(std::string_view text, double size) {
  double ems = 0.0;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0U) != 0x80U) ems += letter_width(byte);
  }
  return ems * size;
}

std::vector<std::string> wrapped(std::string_view text, double size, double width) {
  std::vector<std::string> lines;
  std::string line;
  while (!text.empty()) {
    const std::size_t blank = std::min(text.find(' '), text.size());
    const std::string word(text.substr(0, blank));
    text.remove_prefix(std::min(text.size(), blank + 1));
    if (word.empty()) continue;
    if (!line.empty() && text_width(line, size) + text_width(" ", size) + text_width(word, size) > width) {
      lines.push_back(std::move(line));
      line.clear();
    }
    if (!line.empty()) line += ' ';
    line += word;
  }
  if (!line.empty()) lines.push_back(std::move(line));
  return lines;
}

}  // namespace bolo::plot
