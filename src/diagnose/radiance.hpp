// Band radiance of a black body, 7.5 to 14 um, in kelvin of its own: signal(300 K) = 300, slope 1 there.
#pragma once

#include <vector>

namespace bolo::diagnose {

// 200..700 K, beyond it goes straight on. Source: Planck's law, integrated over the band. Thread: any.
double band_signal(double temperature_k) noexcept;
double band_temperature(double signal) noexcept;

// Between temperature (0) and band radiance (1). `share` 0 gives the argument itself. Thread: any.
double mixed_signal(double temperature_k, double share) noexcept;
double mixed_temperature(double signal, double share) noexcept;

// mixed_temperature() of many values between two signals, from a table: off by less than 20 uK.
class TemperatureTable {
 public:
  TemperatureTable(double share, double low, double high);
  double at(double signal) const noexcept;

 private:
  double low_ = 0.0;
  double scale_ = 1.0;
  std::vector<double> value_;
};

}  // namespace bolo::diagnose
