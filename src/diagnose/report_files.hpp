// The report as files.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

// report.json as one line of text. Thread: any.
std::string report_json(const Report& report);

// A page that needs nothing but itself. Thread: any.
std::string report_html(const Report& report);

// The files of a report in `folder`: report.json and report.html. Thread: any.
std::vector<std::filesystem::path> report_files(const std::filesystem::path& folder);

// Writes report_files(); makes the folder. Thread: setup.
Status write_report(const Report& report, const std::filesystem::path& folder, Replace replace);

}  // namespace bolo::diagnose
