// Forward models in closed form: what a pixel shows of a chopper (sums of exponentials) and of moving bars (a Fourier
// series, whose every harmonic passes optics, pixel and read-out as a factor); what is believed of camera and stimulus,
// and what they would show.
#pragma once

#include "src/diagnose/session.hpp"

namespace bolo::diagnose {

using model::FrameFilter;

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
  double edge_px2 = 0.0;     // variance of the target's own edges, as far as they are Gaussian
  double ramp_px = 0.0;      // and over which they are straight ramps
  double aperture_px = 1.0;  // width over which a pixel averages
  double lean_px = 0.0;      // by which bars lean within the height that a pixel sees
};

// What a pixel shows of bars of height 1 on 0, by the phase of the bars at the pixel.
class BarTable {
 public:
  // `signal`: from the share of a pixel that bars cover to the share of the signal that it gets; empty: the same.
  BarTable(const Bars& bars, const Response& response, const std::function<double(double)>& signal = {});
  double at(double phase_px) const noexcept;     // phase: any number
  double slope(double phase_px) const noexcept;  // by phase, 1/px

  // Tables that differ in their response alone are read at the same place: it is found once.
  struct Cell {
    std::size_t index = 0;
    float share = 0.0F;  // of the way to the next value
  };
  Cell cell(double phase_px) const noexcept;
  double moving_at(Cell cell) const noexcept {
    return value_[cell.index] + cell.share * (value_[cell.index + 1] - value_[cell.index]);
  }

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

// Where and when a value was read: what an effect that only adds to the read-out may depend on.
struct Place {
  double row = 0.0;     // 0..1 from the first to the last
  double column = 0.0;  // 0..1
  double t_s = 0.0;     // camera's clock
};
Place place_in(const Session& session, int row, int column, double t_s);

// About which the references of gains are looked for.
inline constexpr double kReference = 300.0;

struct CameraModel {
  Response response;
  double nominal_tau_s = 0.011;            // of the profile
  double row_delay_s = 0.0;                // of one sensor row
  bool two_halves = false;                 // both halves of the rows are read at the same time
  double radiance = 0.0;                   // 1: the pixel is of first order in radiance, 0: in temperature
  bool edges_in_temperature = false;       // pixels average over the target's temperature, not its radiance
  double reflected = 0.0;                  // 1 - emissivity
  double surroundings = 0.0;               // radiance of the surroundings times `reflected`, less that of kSurroundings
  double pixel_height = 0.0;               // of the rows' distance, over which a pixel sees; it shows where bars lean
  double corner_gain = 0.0;                // added at the corners, growing with the square of the radius
  double tilt_x = 0.0;                     // with the above: added at the right and the lower edge, for a centre
  double tilt_y = 0.0;                     // that is not the image's
  double corner_bend = 0.0;                // the same grows by this share of itself towards the corners
  double corner_reference_k = kReference;  // at which these make no difference: the housing that shows in their place
  double clock_skew = 0.0;                 // the frame period is longer by this share
  double clip_k = std::numeric_limits<double>::infinity();  // values from here on up say nothing
  double heating_k = 0.0;  // of the last row; the offset grows as 1 - exp(-heating_rate row), row 0..1
  double heating_rate = 3.0;
  Eigen::VectorXf offset;                    // K of each pixel of the grid; empty: none
  Eigen::VectorXf gain;                      // share of T - gain_reference_k; empty: none
  double gain_reference_k = kReference;      // at which gains were last made equal
  Eigen::VectorXf tau;                       // share of tau; empty: none
  std::vector<std::array<double, 3>> drift;  // K of each recording: linear, quadratic, cubic in its own time
  std::vector<double> drift_level;           // K of each recording: its mean drift, which its levels have taken up
  Eigen::VectorXf drift_share;               // of each pixel: by how much more it drifts than the mean; empty: none
  // Terms of effects that only add: value of the parameter and what one unit of it adds, K.
  struct Term {
    double value = 0.0;
    std::function<double(const Place&, double temperature_k)> unit;
  };
  std::vector<Term> terms;
};

// What is added to a pixel's gain by light that is lost towards the corners.
double corner_gain_at(const Session& session, const CameraModel& camera, int row, int column);

// What the read-out's heat adds in a row, 0..1, K.
double heating_at(const CameraModel& camera, double row);

// The drift of a recording (its index among the session's) at a time of its own, K: a cubic about its mean.
double drift_at(const CameraModel& camera, const Recording& recording, std::size_t index, double t_s);

inline constexpr double kSurroundings = 295.0;

// Errors of one recording's stimulus, and when its frames were taken.
struct StimulusState {
  std::vector<double> level_k;     // uniform: 1; chopper: cold, then each of levels_of(); bars: cold, hot
  double delay_s = 0.0;            // chopper
  double sweep_s = 0.0;            // chopper: from the first to the last column
  double softness_s = 0.0;         // chopper: over which a pixel is covered or uncovered
  double phase_px = 0.0;           // still bars
  std::vector<double> shift_px;    // moving bars: of the target at each frame, at row 0
  std::vector<double> speed_px_s;  // moving bars: local
  std::vector<double> late_s;      // each frame was taken this much later than its time says
  bool times_free = false;         // chopper: late_s of every frame is fitted
  double mean_speed() const;       // moving bars, px/s
};

struct State {
  CameraModel camera;
  std::vector<StimulusState> stimuli;  // one a recording
  // Of the edges of all bars, along x: their standard deviation, not the variance, for where an edge just reaches a
  // pixel it shows to first order; and the share of its square that straight ramps have, the rest being Gaussian.
  double edge_px = 0.0;
  double edge_ramp = 0.5;
};

// Different heights of a chopper's pulses, rising.
std::vector<double> levels_of(const capture::Chopper& chopper);

// The nominal simulator and the stimuli as their files describe them.
State nominal_state(const Session& session, const model::CameraProfile& profile);

// What the pixels (of the grid) of a recording show: frames x pixels, K. Recordings without a stimulus that has a
// forward model show nothing: has_model() is false. Thread: any.
bool has_model(const Recording& recording);
std::vector<std::size_t> modelled(const Session& session);  // the recordings that have a model
Series predict(const Session& session, std::size_t recording, const State& state, std::span<const int> pixels);

// A table of responses to read off for pixels whose time constants differ: three tables, and Lagrange's polynomial in
// the logarithm of tau.
template <typename Table>
struct TauTables {
  static constexpr double kStep = 0.08;  // of the logarithm, between two tables

  // `make`: from a response to its table; one table where pixels do not differ.
  template <typename Make>
  TauTables(const Response& response, bool differ, const Make& make) {
    for (const double log_tau : {-kStep, 0.0, kStep}) {
      if (log_tau != 0.0 && !differ) continue;
      Response scaled = response;
      if (log_tau != 0.0) scaled.tau_s *= std::exp(log_tau);
      tables.push_back(make(scaled));
    }
  }
  const Table& middle() const { return tables[tables.size() / 2]; }
  double at(double x, double log_tau) const {
    if (tables.size() == 1) return tables[0].at(x);
    const double f = log_tau / kStep;
    const auto mixed = [f](double shorter, double middle, double longer) {
      return f * (f - 1.0) / 2.0 * shorter + (1.0 - f * f) * middle + f * (f + 1.0) / 2.0 * longer;
    };
    if constexpr (requires { tables[0].cell(x); }) {
      const auto cell = tables[0].cell(x);
      return mixed(tables[0].moving_at(cell), tables[1].moving_at(cell), tables[2].moving_at(cell));
    } else {
      return mixed(tables[0].at(x), tables[1].at(x), tables[2].at(x));
    }
  }
  std::vector<Table> tables;
};

// The same for one frame of moving bars that are shifted to `shift_px`: values and their slope by the shift, K/px.
class BarsModel {
 public:
  BarsModel(const Session& session, std::size_t recording, const State& state);
  void frame(std::size_t k, double shift_px, std::span<const int> pixels, float* values, float* slopes) const;
  double mean_speed() const { return mean_speed_; }

 private:
  const Session& session_;
  const CameraModel& camera_;
  const StimulusState& stimulus_;
  const capture::BarTarget& target_;
  bool moving_;  // its speed always varies a little, so that pixels differ
  double mean_speed_;
  double cold_;
  double span_;
  TauTables<BarTable> tables_;
  struct Place {
    double x = 0.0;  // across the bars, px
    double late_s = 0.0;
  };
  std::vector<Place> places_;  // of the grid's pixels
};

}  // namespace bolo::diagnose
