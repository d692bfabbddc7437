// Forward models in closed form: what a pixel shows of a chopper (sums of exponentials) and of moving bars (a Fourier
// series, whose every harmonic passes optics, pixel and read-out as a factor).
#pragma once

#include <functional>
#include <span>
#include <vector>

namespace bolo::diagnose {

enum class FrameFilter { kNone, kRecursive, kBox };

// All that is linear between the scene and the read-out.
struct Response {
  double tau_s = 0.011;
  double slow_share = 0.0;  // of the response, with slow_tau_s
  double slow_tau_s = 0.15;
  double window_s = 0.0;  // the read-out is the mean over this time; its centre is the sample's time
  double blur_px2 = 0.0;  // variance of the optics' Gaussian blur
  double coupling = 0.0;  // to each of four neighbours, in units of the conductance to the substrate
  FrameFilter filter = FrameFilter::kNone;
  double alpha = 1.0;       // weight of the new frame
  double period_s = 0.005;  // between frames
};

// A step of the input: at t_s it changes by `height`.
struct Step {
  double t_s = 0.0;
  double height = 0.0;
};

// The response to steps, on a fine grid of times; zero before the first one.
class StepTable {
 public:
  // Steps in order. The table reaches from the first step's time to `end_s`.
  StepTable(std::span<const Step> steps, const Response& response, double end_s);
  double at(double t_s) const noexcept;

 private:
  double instant(double t_s) const noexcept;
  double integral(double t_s) const noexcept;
  struct Kink {
    double t_s;
    double value;
  };
  double start_s_ = 0.0;
  double window_s_ = 0.0;
  std::vector<double> value_;
  std::vector<double> integral_;
  std::vector<Kink> kinks_;
  std::vector<int> kink_of_;  // of each interval: index of its kink, -1: none, -2: several
};

struct Bars {
  double period_px = 0.0;
  double bar_width_px = 0.0;
  double slant_px_per_row = 0.0;
  double velocity_px_s = 0.0;
  double edge_px2 = 0.0;     // variance of the target's own edges
  double aperture_px = 1.0;  // width over which a pixel averages
};

// What a pixel shows of bars of height 1 on 0, by the phase of the bars at the pixel.
class BarTable {
 public:
  // `signal`: from the share of a pixel that bars cover to the share of the signal that it gets; empty: the same.
  BarTable(const Bars& bars, const Response& response, const std::function<double(double)>& signal = {});
  double at(double phase_px) const noexcept;     // phase: any number
  double slope(double phase_px) const noexcept;  // by phase, 1/px

 private:
  double covered(double phase_px) const noexcept;  // the share of the signal that a still pixel gets, in closed form
  double scale_ = 0.0;
  Bars bars_;
  bool still_ = false;  // value_ is what conduction adds to covered()
  double sigma_px_ = 0.0;
  std::vector<double> signal_;  // of shares from 0 to 1; empty: the same
  std::vector<float> value_;    // one period and one more
};

// Band radiance of a black body, 7.5 to 14 um, in kelvin of its own: signal(300 K) = 300, slope 1 there.

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
