// What a recording tells without a model of what it looks at: from single pixels and whole frames alone.
#pragma once

#include "src/diagnose/report.hpp"
#include "src/diagnose/session.hpp"

namespace bolo::diagnose {

// Jumps, freezes, flicker, noise, patterns and outlier pixels of one recording. Thread: any.
Observation observe(const Recording& recording);

}  // namespace bolo::diagnose
