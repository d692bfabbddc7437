// The report as files.
#pragma once

#include <filesystem>
#include <string>

#include "src/core/result.hpp"
#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

// report.json as one line of text. Thread: any.
std::string report_json(const Report& report);

// A page that needs nothing but itself. Thread: any.
std::string report_html(const Report& report);

// Writes `folder`/report.json and `folder`/report.html; makes the folder. Thread: setup.
Status write_report(const Report& report, const std::filesystem::path& folder);

}  // namespace bolo::diagnose
