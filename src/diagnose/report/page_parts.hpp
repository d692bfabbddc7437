// Parts of the page with drawings, each HTML, empty when the report has nothing for it. Thread of all: any.
#pragma once

#include <string>

#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

std::string captures_part(const Report& report);  // maps, profiles, spectra, answers in time
std::string noise_part(const Report& report);     // statistics as dumbbells
std::string maps_part(const Report& report);      // what was diagnosed of single pixels

}  // namespace bolo::diagnose
