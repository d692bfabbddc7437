// Planck's law over the band of an uncooled camera, 7.5 to 14 um.
#pragma once

namespace bolo::model {

// Band radiance of a black body in kelvin-like units: 300 at 300 K, where it grows by 1 for each kelvin. `kelvin` above
// 0. Thread: any.
double band_radiance(double kelvin) noexcept;

// The temperature of that radiance, K, from 100 to 1500 K; radiances beyond are those of the ends. Good to 1e-6 K.
// Thread: any.
double band_temperature(double radiance) noexcept;

}  // namespace bolo::model
