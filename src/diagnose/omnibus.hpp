// Is anything left? Tests of the residual that name no effect, only the place.
#pragma once

#include <string>
#include <vector>

#include "fit.hpp"
#include "noise.hpp"

namespace bolo::diagnose {

struct Remainder {
  std::string stage;
  std::string where;  // one sentence
  double z = 0.0;     // in standard errors
};

// Tests of the residual of a fit; each in standard errors, largest first.
std::vector<Remainder> test_residual(const Fitter& fitter, const State& state);

// Standard errors above which something is left: from sessions without any effect.
inline constexpr double kRemainderLimit = 5.5;

}  // namespace bolo::diagnose
