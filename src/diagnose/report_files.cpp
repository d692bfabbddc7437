#include "src/diagnose/report_files.hpp"

#include "src/report/sheet.hpp"

namespace bolo::diagnose {
Status write_report(const Report& report, const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return bad_input(folder.string() + ": cannot be made a folder: " + error.message() + "; choose another");
  }
  const Status json = plot::write_text(folder / "report.json", report_json(report) + '\n');
  return json ? plot::write_text(folder / "report.html", report_html(report)) : json;
}

}  // namespace bolo::diagnose
