#include "bolo/diagnose/report_files.hpp"

#include <cerrno>
#include <cstring>
#include <fstream>

namespace bolo::diagnose {
namespace {

Status write_text(const std::filesystem::path& file, const std::string& text) {
  errno = 0;
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out << text;
  out.close();
  if (out) return {};
  const std::string why = errno != 0 ? std::strerror(errno) : "the disk took only a part";
  return bad_input(file.string() + ": cannot be written: " + why + "; choose another folder");
}

}  // namespace

Status write_report(const Report& report, const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return bad_input(folder.string() + ": cannot be made a folder: " + error.message() + "; choose another");
  }
  const Status json = write_text(folder / "report.json", report_json(report) + '\n');
  return json ? write_text(folder / "report.html", report_html(report)) : json;
}

}  // namespace bolo::diagnose
