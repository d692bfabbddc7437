// Band radiance of a black body from 7.5 to 14 um (Planck), in units that make it read like kelvin.
#pragma once

namespace bolo::sim {

// The radiance of a black body at `kelvin`, straightened so that it touches the kelvin scale at 300 K: value and slope
// are those of the temperature there. Good to 20 uK from 100 to 2000 K, straight beyond. Thread: any.
double radiance_of(double kelvin) noexcept;

// The temperature of a black body of this radiance. Thread: any.
double temperature_of(double radiance) noexcept;

}  // namespace bolo::sim
