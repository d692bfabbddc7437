#include "src/report/sheet.hpp"

#include <algorithm>
#include <utility>

#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

bool is_number(const std::string& cell) {
  std::size_t at = 0;
  for (const std::string& sign : {std::string("+"), std::string("-"), std::string("\u2212"), std::string("< ")}) {
    if (cell.starts_with(sign)) at = sign.size();
  }
  return at < cell.size() && cell[at] >= '0' && cell[at] <= '9';
}

// Columns that are mostly numbers: they are aligned to the right.
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
  std::vector<Plot> stack;  // rows of one plot are aligned
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
  const std::string title = escaped(sheet.title);
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/><meta name=\"viewport\" "
         "content=\"width=device-width,initial-scale=1\"/><title>" +
         title + "</title><style>" + page_style() + "</style></head><body><main>\n<h1>" + title + "</h1>\n" + body +
         "</main></body></html>\n";
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
