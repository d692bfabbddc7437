// What the noise's own statistics name.
#include <algorithm>
#include <cmath>

#include "diagnosis.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kLeastComponent = 0.0015;  // K, of flicker and stripes
constexpr double kClear = 8.0;              // standard errors

double confidence_from(double z) { return 1.0 - 0.5 * std::erfc(std::min(z, 6.0) / 2.0); }

bool shows(const Measured& component) { return component.z > kClear && component.value > kLeastComponent; }

}  // namespace

void Diagnosis::name_noise(const std::string& name, double z, std::map<std::string, Estimate> parameters,
                           const std::string& where) {
  FoundEffect e = named(name, confidence_from(z));
  e.of_noise = true;
  e.parameters = std::move(parameters);
  found(std::move(e), z, where);
}

void Diagnosis::judge_noise() {
  noise_ = measure_noise(session_, ceiling_k_);
  // Counts cannot be compared with a profile in kelvin.
  if (!session_.recordings.front().kelvin) {
    report_.warnings.push_back(
        session_.recordings.front().name +
        ": holds counts, not kelvin; figures in K are counts, and the noise's level is not judged");
  }
  set_floor();
  if (noise_.frames == 0) return;
  judge_components();
  judge_spectrum_and_tails();
  judge_rest_of_noise();
}

void Diagnosis::set_floor() {
  const model::CameraProfile& p = options_.profile;
  floor_k_ = noise_.frames > 0 && noise_.total_k > 0.0 ? noise_.total_k : nominal_noise();
  if (coarse_ && p.quantisation_k > 0.0) {
    // A still field sits at one place between two steps; what moves sees the whole step.
    floor_k_ = std::max(floor_k_, std::sqrt(p.noise_k * p.noise_k + step_k_ * step_k_ / 12.0));
  }
  report_.noise_floor_k = floor_k_;
}

// Whole frames, rows and columns.
void Diagnosis::judge_components() {
  if (shows(noise_.flicker)) {
    name_noise("flicker", noise_.flicker.z, {{"sigma_k", interval(noise_.flicker.value, noise_.flicker.error)}},
               "whole frames differ by an offset");
  }
  if (shows(noise_.rows) || shows(noise_.columns)) {
    name_noise("stripes", std::max(noise_.rows.z, noise_.columns.z),
               {{"column_k", interval(noise_.columns.value, noise_.columns.error)},
                {"row_k", interval(noise_.rows.value, noise_.rows.error)}},
               "rows or columns differ by an offset in every frame");
  }
}

void Diagnosis::judge_spectrum_and_tails() {
  const model::CameraProfile& p = options_.profile;
  if (noise_.filter != FrameFilter::kNone) {
    name_noise("iir", noise_.alpha.z, {{"alpha", interval(noise_.alpha.value, noise_.alpha.error)}},
               "the noise is correlated from frame to frame");
  }
  if (noise_.corner_hz.z > 5.0 && noise_.corner_hz.value > 0.08) {
    name_noise("one_over_f", noise_.corner_hz.z,
               {{"corner_hz", interval(noise_.corner_hz.value, noise_.corner_hz.error)}},
               "the noise grows towards low frequencies");
  }
  const bool tails = noise_.excess_kurtosis.z > kClear && noise_.excess_kurtosis.value > 0.25 && !coarse_;
  if (tails) {
    name_noise("heavy_tail", noise_.excess_kurtosis.z, {{"degrees", interval(noise_.degrees, noise_.degrees_error)}},
               "the noise has outliers");
  }
  const double scale = noise_.white_k / nominal_noise();
  const double margin = tails ? 1.12 : 1.04;
  if (scale > margin && !coarse_) {
    const double error = 0.004 * scale;
    const double quantisation2 = p.quantisation_k * p.quantisation_k / 12.0;
    const double own = std::sqrt(std::max(0.0, noise_.white_k * noise_.white_k - quantisation2)) / p.noise_k;
    name_noise("noise_level", (scale - 1.0) / error, {{"scale", interval(own, error)}},
               "the noise is stronger than the profile says");
  }
}

// What no effect of the catalogue does.
void Diagnosis::judge_rest_of_noise() {
  if (noise_.line_p < 1e-6) {
    remain("readout",
           "a line at " + std::to_string(static_cast<int>(std::lround(noise_.line_hz))) +
               " Hz in the means of frames or of their halves",
           kClear);
  }
  // Neighbours that share noise: what flicker and stripes leave is taken out already.
  if (std::abs(noise_.neighbour_row_z) > kClear) {
    remain("readout", "the noise of a pixel shows in its neighbour in the row", std::abs(noise_.neighbour_row_z));
  }
  if (std::abs(noise_.neighbour_column_z) > kClear) {
    remain("readout", "the noise of a pixel shows in its neighbour in the column", std::abs(noise_.neighbour_column_z));
  }
  if (noise_.spectrum_misfit > 7.0 && !coarse_) {
    remain("noise", "the noise's spectrum has a shape that no effect gives it", noise_.spectrum_misfit);
  }
}

}  // namespace bolo::diagnose
