// The report in words and numbers that a person would say.
#pragma once

#include <string>
#include <vector>

#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

// A value of the parameter `key` with its unit: "27.9 us", "12 %". The unit follows from the key's ending (_s, _k, _hz,
// _px) or, for shares and the like, from the key. `utf8`: with a micro sign. Thread: any.
std::string quantity(const std::string& key, double value, bool utf8 = false);

// Value and 95 % interval in one unit: "27.9 us (26.0 to 30.1)". Thread: any.
std::string quantity(const std::string& key, const Estimate& estimate, bool utf8 = false);

// "tau_global" -> "Time constant". A name that is not known is returned with blanks for underscores. Thread: any.
std::string effect_title(const std::string& name);

// What the effect does, with its numbers: "Rows are sampled 27.9 us after one another". Thread: any.
std::string effect_sentence(const FoundEffect& effect, bool utf8 = false);

// The verdict in one or two sentences. Thread: any.
std::string headline(const Report& report, bool utf8 = false);

// A gap in words: "7.9", "1.02". Thread: any.
std::string gap_text(double gap);

// What a capture tells without a model, one sentence each: jumps with their frames, freezes, noise, patterns, outliers.
// Thread: any.
std::vector<std::string> describe(const Observation& observation);

// "3 stuck: (12, 5), (100, 40), (7, 81)": the first few places. Thread: any.
std::string describe(const std::vector<PixelPlace>& pixels, const std::string& what);

// Some lines of text for a terminal: verdict, effects, gap, stimulus, what cannot be told, warnings. Thread: any.
std::string report_summary(const Report& report);

}  // namespace bolo::diagnose
