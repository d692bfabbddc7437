// The score for people and for programs.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "tools/lab/blind/score.hpp"
#include "tools/lab/blind/seal.hpp"

namespace bolo::tools::blind {

// How to draw the same sessions again.
struct Setting {
  DrawOptions draw;
  std::string digest;
  double seconds = 0.0;  // of the whole check
};

// Lines for a terminal, each ended. Thread: any.
std::string score_text(const Score& score, const Setting& setting);

// Keys in snake_case. Thread: any.
nlohmann::ordered_json score_json(const Score& score, const Setting& setting);

// A page with the tables and the confusion matrix as a heat map; needs nothing but itself. Thread: any.
std::string score_html(const Score& score, const Setting& setting);

// The words that draw one session again. Thread: any.
std::string rerun_words(const Failure& failure, const DrawOptions& draw);

}  // namespace bolo::tools::blind
