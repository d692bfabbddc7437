#include "src/report/sheet.hpp"

#include <utility>
#include <vector>

namespace bolo::plot {
namespace {

std::string page_of(const Sheet& sheet) {
  Page page(sheet.title);
  std::vector<Plot> stack;  // rows of one plot are aligned
  for (const std::vector<Plot>& row : sheet.rows) {
    if (row.size() == 1) {
      stack.push_back(row.front());
      continue;
    }
    page.stacked(std::exchange(stack, {}));
    page.beside(row);
  }
  page.stacked(stack);
  for (const Table& table : sheet.tables) page.table(table);
  if (!sheet.how.empty()) {
    page.heading("How it was measured");
    page.quiet(sheet.how);
  }
  return page.html();
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
