#include "bolo/diagnose/report_files.hpp"
#include "bolo/diagnose/report_words.hpp"

namespace bolo::diagnose {

std::string report_html(const Report& report) {
  return "<!doctype html><meta charset=utf-8><title>Gap</title><pre>" + report_summary(report) + "</pre>\n";
}

}  // namespace bolo::diagnose
