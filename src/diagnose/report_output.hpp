// The report as files, as a page, and in sentences. Thread of all but write_report: any.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

// report.json as one line of text.
std::string report_json(const Report& report);

// A page that needs nothing but itself.
std::string report_html(const Report& report);

// Parts of the page with drawings; empty when the report has nothing for it.
std::string captures_part(const Report& report);  // maps, profiles, spectra, answers in time
std::string noise_part(const Report& report);     // statistics as dumbbells
std::string maps_part(const Report& report);      // what was diagnosed of single pixels
std::string scene_part(const Report& report);     // a frame of a field recording, before and after

// scene_part() as a picture of its own; empty when there is none.
std::string scene_svg(const Report& report);

// The files of a report in `folder`: report.json, report.html and, of field recordings that were followed, scene.svg.
std::vector<std::filesystem::path> report_files(const std::filesystem::path& folder);

// Writes report_files(); makes the folder. Thread: setup.
Status write_report(const Report& report, const std::filesystem::path& folder, Replace replace);

struct Wording {
  bool utf8 = false;   // with a micro sign
  bool kelvin = true;  // false: what ends in _k is of captures in counts
};

// A value of the parameter `key` with its unit: "27.9 us", "12 %". The unit follows from the key's ending (_s, _k, _hz,
// _px) or, for shares and the like, from the key.
std::string quantity(const std::string& key, double value, Wording wording = {});

// Value and 95 % interval in one unit: "27.9 us (26.0 to 30.1)".
std::string quantity(const std::string& key, const Estimate& estimate, Wording wording = {});

// "tau_global" -> "Time constant". A name that is not known is returned with blanks for underscores.
std::string effect_title(const std::string& name);

// What the effect does, with its numbers: "Rows are sampled 27.9 us after one another".
std::string effect_sentence(const FoundEffect& effect, Wording wording = {});

// The verdict in one or two sentences.
std::string headline(const Report& report, bool utf8 = false);

// A gap in words: "7.9", "1.02".
std::string gap_text(double gap);

// What a capture tells without a model, one sentence each: jumps with their frames, freezes, noise, patterns, outliers.
std::vector<std::string> describe(const Observation& observation);

// "3 stuck: (12, 5), (100, 40), (7, 81)": the first few places.
std::string describe(const std::vector<PixelPlace>& pixels, const std::string& what);

// Some lines of text for a terminal: verdict, effects, gap, stimulus, what cannot be told, warnings.
std::string report_summary(const Report& report);

}  // namespace bolo::diagnose
