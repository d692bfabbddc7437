// report.html: the parts in the order in which a person wants to know them.
#include "src/diagnose/report/page_parts.hpp"
#include "src/diagnose/report/page_style.hpp"
#include "src/diagnose/report_files.hpp"
#include "src/report/page.hpp"

namespace bolo::diagnose {

std::string report_html(const Report& report) {
  std::string out =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width,initial-scale=1\"><title>Simulator and camera</title><style>";
  out += plot::page_style() + kReportStyle;
  out += "</style></head><body><main>\n";
  for (const auto part : {head_part, waterfall_part, effects_part, location_part, unexplained_part, observed_part,
                          captures_part, noise_part, maps_part, stimulus_part, limits_part}) {
    out += part(report);
    out += '\n';
  }
  return out + "</main></body></html>\n";
}

}  // namespace bolo::diagnose
