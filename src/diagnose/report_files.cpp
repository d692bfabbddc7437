#include "src/diagnose/report_files.hpp"

namespace bolo::diagnose {

std::vector<std::filesystem::path> report_files(const std::filesystem::path& folder) {
  return {folder / "report.json", folder / "report.html"};
}

Status write_report(const Report& report, const std::filesystem::path& folder, Replace replace) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return bad_input(folder.string() + ": cannot be made a folder: " + error.message() + "; choose another");
  }
  const auto files = report_files(folder);
  const Status json = write_file({files[0], replace}, report_json(report) + '\n');
  return json ? write_file({files[1], replace}, report_html(report)) : json;
}

}  // namespace bolo::diagnose
