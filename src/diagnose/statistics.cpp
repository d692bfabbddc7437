#include "statistics.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include <unsupported/Eigen/FFT>

namespace bolo::diagnose {

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<long>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void Line::add(double x, double y) {
  n_ += 1.0;
  sx_ += x;
  sy_ += y;
  sxx_ += x * x;
  sxy_ += x * y;
  syy_ += y * y;
}

std::vector<double> periodogram(const Eigen::ArrayXd& x) {
  const Eigen::Index n = x.size();
  std::vector<double> windowed(static_cast<std::size_t>(n));
  double norm = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    const double w =
        0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(k) + 0.5) / static_cast<double>(n));
    windowed[static_cast<std::size_t>(k)] = w * x[k];
    norm += w * w;
  }
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<std::complex<double>> spectrum;
  fft.fwd(spectrum, windowed);
  std::vector<double> power;
  power.reserve(spectrum.size());
  for (const auto& s : spectrum) power.push_back(std::norm(s) / norm);
  return power;
}

}  // namespace bolo::diagnose
