// The paper's camera, for defaults. Apart from bolometer.hpp so that settings do not drag in linear algebra.
#pragma once

namespace bolo::model {

inline constexpr double kA655scTau = 0.011;     // s, the paper's measurement
inline constexpr double kA655scPeriod = 0.005;  // s, 640x120 at 200 Hz

}  // namespace bolo::model
