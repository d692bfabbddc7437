// Is anything left? Tests of the residual that name no effect, only the place.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "fit.hpp"
#include "noise.hpp"

namespace bolo::diagnose {

struct Remainder {
  std::string stage;
  std::string where;  // one sentence
  double z = 0.0;     // in standard errors
  // Of a misfit that tells no cause by itself: the kind of capture that it is in, and whether it keeps to the target's
  // edges.
  std::optional<Kind> misfit{};
  bool at_edges = false;
};

// The stage that misfits point to by the captures which they are in and those which fit.
std::string stage_of_misfits(std::span<const Remainder> remainders);

// What may be left without a reason of its own, in units of the noise floor (rms).
struct Allowance {
  double pattern = 0.06;        // of a fixed pattern: what the forward models are off by
  double slow_noise = 1.0;      // by how much noise that is correlated in time widens the tests
  bool times_free = false;      // of a chopper's frames: those at its very edges may miss
  double flicker = 0.0;         // of whole frames, rms
  std::vector<char> corrected;  // recordings out of which a jump was taken: the estimate leaves a pattern
};

// Tests of the residual of a fit; each in standard errors, largest first.
std::vector<Remainder> test_residual(const Fitter& fitter, const State& state, const Allowance& allowance);

// Standard errors above which something is left: from sessions without any effect.
inline constexpr double kRemainderLimit = 5.5;

}  // namespace bolo::diagnose
