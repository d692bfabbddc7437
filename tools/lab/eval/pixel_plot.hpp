// What is drawn of `bolo-lab eval pixel`.
#pragma once

#include <span>

#include "src/report/sheet.hpp"
#include "tools/lab/eval/pixel_trial.hpp"

namespace bolo::tools {

// The first draw of each case, two beside each other. Thread: any.
plot::Sheet sheet_of(const PixelTrial& trial, std::span<const PixelScore> scores);

}  // namespace bolo::tools
