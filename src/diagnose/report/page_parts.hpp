// The parts of the page, each HTML, empty when the report has nothing for it. Thread of all: any.
#pragma once

#include <string>

#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

std::string head_part(const Report& report);       // verdict, headline, the four numbers
std::string waterfall_part(const Report& report);  // the gap from effect to effect
std::string effects_part(const Report& report);    // parameters, confidence, alternatives
std::string location_part(const Report& report);   // stage, rows, columns, times, captures
std::string unexplained_part(const Report& report);
std::string stimulus_part(const Report& report);  // errors of the bench
std::string captures_part(const Report& report);  // maps, profiles, spectra, answers in time
std::string noise_part(const Report& report);     // statistics as dumbbells
std::string maps_part(const Report& report);      // what was diagnosed of single pixels
std::string observed_part(const Report& report);  // what frames and pixels tell without a model
std::string limits_part(const Report& report);    // what cannot be told, warnings, inputs

}  // namespace bolo::diagnose
