// What a change of one pixel's value does to its readings: the columns of every regression of maps.
#pragma once

#include <array>
#include <span>

#include "effect.hpp"

namespace bolo::diagnose {

inline constexpr std::array<MapKind, 4> kMapKinds{MapKind::kOffset, MapKind::kGain, MapKind::kTau, MapKind::kDrift};

// Frames x pixels, per unit: 1, T - kGainReference, dT / d ln tau, the drift. Thread: any.
Series basis_of(const Session& session, std::size_t recording, const State& state, MapKind kind,
                std::span<const int> pixels);

}  // namespace bolo::diagnose
