// Forward models in closed form: a pixel's response to a chopper (sums of exponentials) and to moving bars (Fourier
// series; optics, pixel and read-out are factors on each harmonic); the state of camera and stimulus.
#pragma once

#include <complex>

#include "src/diagnose/session.hpp"

namespace bolo::diagnose {

using model::FrameFilter;

// The linear response from the scene to the read-out.
struct Response {
  double tau_s = 0.011;
  double slow_share = 0.0;  // share of the response with slow_tau_s
  double slow_tau_s = 0.15;
  double window_s = 0.0;  // the reading is the mean over this time, centred at the sample's time
  double blur_px2 = 0.0;  // variance of the optics' Gaussian blur
  double coupling = 0.0;  // to each of four neighbours, in units of the conductance to the substrate
  FrameFilter filter = FrameFilter::kNone;
  double alpha = 1.0;       // weight of the new frame
  double period_s = 0.005;  // between frames
  bool operator==(const Response&) const = default;
  // The same with another time constant; `log_tau`: logarithm of its ratio.
  Response slower(double log_tau) const {
    Response other = *this;
    other.tau_s *= std::exp(log_tau);
    return other;
  }
};

// A step of the input by `height` at t_s.
struct Step {
  double t_s = 0.0;
  double height = 0.0;
};

// The response to steps: sums of exponentials that continue from the state at the last step; zero before the first one.
class StepResponse {
 public:
  // `steps`: in order of time.
  StepResponse(std::span<const Step> steps, const Response& response);
  double at(double t_s) const noexcept;

 private:
  // The response of one time constant, and its integral.
  struct Pole {
    double tau_s = 0.0;
    double value = 0.0;
    double integral = 0.0;
    void run(double dt, double input) noexcept;
  };
  // State after a step.
  struct Node {
    double t_s = 0.0;
    double input = 0.0;
    Pole fast;
    Pole slow;
  };
  double mixed(const Node& node, double Pole::*of) const noexcept;
  Node node_at(double t_s) const noexcept;
  std::vector<Node> nodes_;  // the first one long before all steps
  double slow_share_;
  double window_s_;
};

struct Bars {
  double period_px = 0.0;
  double bar_width_px = 0.0;
  double slant_px_per_row = 0.0;
  double velocity_px_s = 0.0;
  double edge_px2 = 0.0;     // variance of the target's own edges: their Gaussian part
  double ramp_px = 0.0;      // width of their straight ramp
  double aperture_px = 1.0;  // width over which a pixel averages
};

// Scene signal of bars of height 1 on 0 before the pixel's response, by the bars' phase.
struct BarShape {
  // `signal`: maps the covered share of a pixel to its share of the signal; empty: identity.
  BarShape(const Bars& bars, double blur_px2, const std::function<double(double)>& signal = {});

  Bars bars;
  double sigma_px = 0.0;                       // of optics and edges together
  std::vector<std::complex<double>> spectrum;  // of one period
  std::vector<double> signal_of_share;         // for still bars, by shares from 0 to 1; empty: identity
};

// A pixel's response to bars, tabulated by the bars' phase at the pixel.
class BarTable {
 public:
  static constexpr int kPhases = 8192;

  BarTable(const BarShape& shape, const Response& response);
  double at(double phase_px) const noexcept;     // phase: any number
  double slope(double phase_px) const noexcept;  // derivative by phase, 1/px

  // A position computed once and valid in all tables of the same bars.
  struct Cell {
    std::size_t index = 0;
    float share = 0.0F;  // fraction of the way to the next value
  };
  Cell cell(double phase_px) const noexcept {
    const double turns = phase_px / bars_.period_px;
    const double part = turns - static_cast<double>(static_cast<std::int64_t>(turns));
    const double at = (part < 0.0 ? part + 1.0 : part) * kPhases;
    const std::size_t i = std::min(static_cast<std::size_t>(at), static_cast<std::size_t>(kPhases - 1));
    return {i, static_cast<float>(at - static_cast<double>(i))};
  }
  double moving_at(Cell cell) const noexcept {
    return value_[cell.index] + cell.share * (value_[cell.index + 1] - value_[cell.index]);
  }

 private:
  double covered(double phase_px) const noexcept;  // a still pixel's share of the signal, in closed form
  Bars bars_;
  bool still_ = false;  // value_ holds only what conduction adds to covered()
  double sigma_px_ = 0.0;
  std::vector<double> signal_;  // BarShape::signal_of_share
  std::vector<float> value_;    // one period and one value more
};

// Band radiance of a black body, 7.5 to 14 um, scaled to signal(300 K) = 300 with slope 1.

// Valid for 200..700 K, linear beyond. Source: Planck's law, integrated over the band. Thread: any.
double band_signal(double temperature_k) noexcept;
double band_temperature(double signal) noexcept;

// Blend of temperature (`share` 0: the argument itself) and band radiance (1). Thread: any.
double mixed_signal(double temperature_k, double share) noexcept;
double mixed_temperature(double signal, double share) noexcept;

// mixed_temperature() between two signals, from a table: error below 20 uK.
class TemperatureTable {
 public:
  TemperatureTable(double share, double low, double high);
  double at(double signal) const noexcept;

 private:
  double low_ = 0.0;
  double scale_ = 1.0;
  std::vector<double> value_;
};

// Relative position of a pixel, on which purely additive effects depend.
struct Place {
  double row = 0.0;     // 0..1 from the first to the last row
  double column = 0.0;  // 0..1
};
Place place_in(const Session& session, int row, int column);

// Centre of the search range of the gains' reference temperatures, K.
inline constexpr double kReference = 300.0;

// What determines the signal of a pixel, before the read-out, if all pixels are alike.
struct PixelModel {
  Response response;
  double nominal_tau_s = 0.011;       // of the profile
  double row_delay_s = 0.0;           // per sensor row
  bool two_halves = false;            // both halves of the rows are read at the same time
  double radiance = 0.0;              // 1: the pixel is first-order in radiance, 0: in temperature
  bool edges_in_temperature = false;  // pixels average the target's temperature, not its radiance
  double reflected = 0.0;             // 1 - emissivity
  double surroundings = 0.0;          // excess of radiance over kSurroundings', times `reflected`
  double clock_skew = 0.0;            // relative excess of the frame period
  bool operator==(const PixelModel&) const = default;
};

struct CameraModel : PixelModel {
  Eigen::VectorXf tau;  // relative excess of tau, per pixel; empty: none
  // The read-out.
  double corner_gain = 0.0;                // added at the corners, growing with the square of the radius
  double tilt_x = 0.0;                     // added to corner_gain at the right and lower edges, for an optical centre
  double tilt_y = 0.0;                     // that is not the image's
  double corner_bend = 0.0;                // relative growth of these gains towards the corners
  double corner_reference_k = kReference;  // temperature of the housing, at which these gains cancel
  double clip_k = std::numeric_limits<double>::infinity();  // values from here on are not used
  double heating_k = 0.0;  // of the last row; the offset grows as 1 - exp(-heating_rate row), row 0..1
  double heating_rate = 3.0;
  Eigen::VectorXf offset;                    // K of each pixel of the grid; empty: none
  Eigen::VectorXf gain;                      // factor of T - gain_reference_k, per pixel; empty: none
  double gain_reference_k = kReference;      // temperature at which gains were last equalised
  std::vector<std::array<double, 3>> drift;  // K of each recording: linear, quadratic, cubic in its own time
  std::vector<double> drift_level;           // K of each recording: its mean drift, absorbed by its levels
  Eigen::VectorXf drift_share;               // relative excess of a pixel's drift; empty: none
  // Additive effects: value of the parameter, and contribution of one unit of it, K.
  struct Term {
    double value = 0.0;
    std::function<double(const Place&, double temperature_k)> unit;
  };
  std::vector<Term> terms;
};

// Gain added to a pixel by the fall-off of light towards the corners.
double corner_gain_at(const Session& session, const CameraModel& camera, int row, int column);

// Offset in a row (0..1) by heat of the read-out, K.
double heating_at(const CameraModel& camera, double row);

// Drift of a recording (`index` in the session) at its own time, K: a cubic about its mean.
double drift_at(const CameraModel& camera, const Recording& recording, std::size_t index, double t_s);

inline constexpr double kSurroundings = 295.0;

// Errors of one recording's stimulus and of its frame times.
struct StimulusState {
  std::vector<double> level_k;     // uniform: 1; chopper: cold, then each of levels_of(); bars: cold, hot
  double delay_s = 0.0;            // chopper
  double sweep_s = 0.0;            // chopper: delay from the first to the last column
  double softness_s = 0.0;         // chopper: time to cover a pixel
  double phase_px = 0.0;           // still bars
  std::vector<double> shift_px;    // moving bars: of the target in each frame, at row 0
  std::vector<double> speed_px_s;  // moving bars: in each frame
  std::vector<double> late_s;      // delay of each frame after its nominal time
  bool times_free = false;         // chopper: late_s of every frame is an unknown
  double mean_speed() const;       // moving bars, px/s
  bool operator==(const StimulusState&) const = default;
};

struct State {
  CameraModel camera;
  std::vector<StimulusState> stimuli;  // one per recording
  // Width of all bars' edges along x. Standard deviation, not variance: where an edge just reaches a pixel, the effect
  // is of first order in it. edge_ramp: share of its square that is a straight ramp; the rest is Gaussian.
  double edge_px = 0.0;
  double edge_ramp = 0.5;
  // Width and height over which a pixel averages; less than 1 if the absorber does not fill the pixel. No width of
  // edges can model this: a smaller aperture behind softer optics gives another edge shape.
  double aperture_px = 1.0;
};

// Distinct heights of a chopper's pulses, rising.
std::vector<double> levels_of(const capture::Chopper& chopper);

// State of the nominal simulator, with the stimuli as described by their files.
State nominal_state(const Session& session, const model::CameraProfile& profile);

std::vector<std::size_t> modelled(const Session& session);  // indices of the recordings with a model
bool has_bench(const Session& session);                     // true if there are any
// Prediction of a recording that has_model() at pixels of the grid: frames x pixels, K. Thread: any.
Series predict(const Session& session, std::size_t recording, const State& state, std::span<const int> pixels);
// Its two parts: the linear quantity that the pixels follow, and what the read-out makes of it.
Series predict_signal(const Session& session, std::size_t recording, const State& state, std::span<const int> pixels);
Series read_out(const Session& session, std::size_t recording, const CameraModel& camera, std::span<const int> pixels,
                Series signal);
// True if predict_signal() is the same for both states, which may differ in the read-out or in other recordings.
bool same_signal(std::size_t recording, const State& a, const State& b);
// Each frame's mean over these pixels, K, and its derivatives by the levels (frames x levels, K/K). Thread: any.
VectorXd frame_means(const Session& session, std::size_t recording, const State& state, std::span<const int> pixels);
MatrixXd level_slopes(const Session& session, std::size_t recording, const State& state, std::span<const int> pixels);

// Tables for pixels of different time constants: three, with Lagrange interpolation in ln tau.
struct BarTables {
  static constexpr double kStep = 0.08;  // of ln tau, between two tables

  // A single table if all pixels are alike.
  BarTables(const BarShape& shape, const Response& response, bool differ) {
    for (const double log_tau : {-kStep, 0.0, kStep}) {
      if (log_tau == 0.0 || differ) tables.emplace_back(shape, response.slower(log_tau));
    }
  }
  const BarTable& middle() const { return tables[tables.size() / 2]; }
  double at(double phase_px, double log_tau) const {
    if (tables.size() == 1) return tables[0].at(phase_px);
    const double f = log_tau / kStep;
    const auto cell = tables[0].cell(phase_px);
    return f * (f - 1.0) / 2.0 * tables[0].moving_at(cell) + (1.0 - f * f) * tables[1].moving_at(cell) +
           f * (f + 1.0) / 2.0 * tables[2].moving_at(cell);
  }
  std::vector<BarTable> tables;
};

// Predicts one frame of moving bars at `shift_px`: values, and their derivative by the shift, K/px.
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
  bool moving_;  // then the speed always varies a little, so that pixels differ
  double mean_speed_;
  double cold_;
  double span_;
  BarTables tables_;
  struct Place {
    double x = 0.0;  // across the bars, px
    double late_s = 0.0;
  };
  std::vector<Place> places_;  // of the grid's pixels
};

}  // namespace bolo::diagnose
