#include "src/report/page.hpp"

#include <algorithm>
#include <iterator>

#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

constexpr double kBroad = 600.0;  // px; broader plots are scrolled on a phone rather than made too small to read

bool is_number(const std::string& cell) {
  std::size_t at = 0;
  for (const std::string& sign : {std::string("+"), std::string("-"), std::string("\u2212"), std::string("< ")}) {
    if (cell.starts_with(sign)) at = sign.size();
  }
  return at < cell.size() && cell[at] >= '0' && cell[at] <= '9';
}

const char* look_of(Verdict verdict) {
  return verdict == Verdict::kGood ? "good" : verdict == Verdict::kWarn ? "warn" : "bad";
}

std::string figure(const Plot& plot, std::string drawing) {
  if (plot.width > kBroad) drawing.replace(drawing.find("bolo-plot"), 9, "bolo-plot broad");
  std::string out = "<figure>";
  if (!plot.title.empty()) out += "<h4>" + escaped(plot.title) + "</h4>";
  if (!plot.caption.empty()) out += "<figcaption>" + escaped(plot.caption) + "</figcaption>";
  return out + "<div class=\"scroll\">" + drawing + "</div></figure>\n";
}

// Whether most of a column are numbers: then all of it stands to the right.
std::vector<bool> number_columns(const Table& table) {
  std::vector<bool> out(table.head.size());
  for (std::size_t c = 0; c < out.size(); ++c) {
    const auto numbers = std::ranges::count_if(
        table.rows, [c](const std::vector<std::string>& row) { return c < row.size() && is_number(row[c]); });
    out[c] = 2 * static_cast<std::size_t>(numbers) > table.rows.size();
  }
  return out;
}

}  // namespace

Page::Page(const std::string& title) : title_(title) {}

void Page::verdict(Verdict verdict, const std::string& word, const std::string& sentence) {
  body_ += format("<span class=\"pill %s\">", look_of(verdict)) + escaped(word) + "</span><p class=\"lead\">" +
           escaped(sentence) + "</p>\n";
}

void Page::heading(const std::string& words) { body_ += "<h2>" + escaped(words) + "</h2>\n"; }
void Page::paragraph(const std::string& words) { body_ += "<p>" + escaped(words) + "</p>\n"; }
void Page::quiet(const std::string& words) { body_ += "<p class=\"soft\">" + escaped(words) + "</p>\n"; }
void Page::code(const std::string& text) { body_ += "<pre>" + escaped(text) + "</pre>\n"; }

void Page::facts(const std::vector<std::pair<std::string, std::string>>& values) {
  body_ += "<div class=\"facts\">";
  for (const auto& [value, name] : values) {
    body_ += "<div class=\"fact\"><b>" + escaped(value) + "</b><span>" + escaped(name) + "</span></div>";
  }
  body_ += "</div>\n";
}

void Page::table(const Table& table) {
  const std::vector<bool> numbers = number_columns(table);
  const auto cells = [&](const char* tag, const std::vector<std::string>& row) {
    std::string out = "<tr>";
    for (std::size_t c = 0; c < row.size(); ++c) {
      const bool number = c < numbers.size() && numbers[c];
      out += format("<%s%s>", tag, number ? " class=\"n\"" : "") + escaped(row[c]) + "</" + tag + ">";
    }
    return out + "</tr>\n";
  };
  body_ += "<div class=\"scroll\"><table>";
  if (!table.caption.empty()) body_ += "<caption>" + escaped(table.caption) + "</caption>";
  body_ += cells("th", table.head);
  for (const auto& row : table.rows) body_ += cells("td", row);
  body_ += "</table></div>\n";
}

void Page::plot(const Plot& plot) { stacked(std::span(&plot, 1)); }

void Page::stacked(std::span<const Plot> plots) {
  std::vector<Plot> drawn;
  std::ranges::copy_if(plots, std::back_inserter(drawn), has_content);
  const std::vector<std::string> drawings = to_aligned_parts(drawn);
  for (std::size_t i = 0; i < drawn.size(); ++i) body_ += figure(drawn[i], drawings[i]);
}

void Page::beside(std::span<const Plot> plots) {
  body_ += "<div class=\"plots\">";
  for (const Plot& one : plots) plot(one);
  body_ += "</div>\n";
}

void Page::html_part(const std::string& html) { body_ += html; }
void Page::style(const std::string& css) { style_ += css; }

std::string Page::html() const {
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/><meta name=\"viewport\" "
         "content=\"width=device-width,initial-scale=1\"/><title>" +
         escaped(title_) + "</title><style>" + page_style() + style_ + "</style></head><body><main>\n<h1>" +
         escaped(title_) + "</h1>\n" + body_ + "</main></body></html>\n";
}

std::string figure_html(const Plot& plot) {
  return has_content(plot) ? figure(plot, to_svg_part(plot)) : std::string();
}

std::string details_begin(const std::string& summary, const std::string& soft, bool open) {
  return format("<details%s><summary>", open ? " open=\"\"" : "") + escaped(summary) + "<span>" + escaped(soft) +
         "</span></summary>";
}

}  // namespace bolo::plot
