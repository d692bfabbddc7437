// Settings of the deblurring, for live and offline work.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "src/core/frame.hpp"
#include "src/core/gyro.hpp"
#include "src/core/result.hpp"
#include "src/model/bolometer.hpp"

namespace bolo::deblur {

enum class Method {
  kAdmm,     // the paper's problem by fixed-iteration ADMM, single precision
  kDual,     // the same problem by fixed sweeps of coordinate descent on its dual, int16 or float: the fastest
  kExact,    // the paper's problem to convergence, double precision: the reference
  kInverse,  // first-order inverse filter: x = (y_1 - a y_0) / (1 - a), a = exp(-T / tau); no prior
  kMmae,     // multiple-model adaptive estimation: linear smoothers for many motions, weighted by how well each fits
  kMotion,   // along the scene's own motion, estimated from the frames; kMmae where it does not explain them
};

// Names as the command line and configuration spell them. Thread: any.
inline constexpr std::array<std::pair<std::string_view, Method>, 6> kMethodNames{{{"admm", Method::kAdmm},
                                                                                  {"dual", Method::kDual},
                                                                                  {"exact", Method::kExact},
                                                                                  {"inverse", Method::kInverse},
                                                                                  {"mmae", Method::kMmae},
                                                                                  {"motion", Method::kMotion}}};
std::string_view name(Method method);
Result<Method> method_from_name(std::string_view name);

// Objective, as in the authors' program: kappa ||V H^T D - Y||^2 + lambda ||D||_1 after subtracting the window's mean.
struct Settings {
  Method method = Method::kAdmm;
  double tau_s = model::kA655scTau;
  double period_s = model::kA655scPeriod;
  int window = 17;  // frames; window - 1 (a power of two) constraints
  int levels = 7;   // n: 2^n bins in the window
  double kappa = 0.1;
  double lambda = 0.001;     // in kelvin, or in counts for a capture that has no kelvin
  bool auto_lambda = false;  // lambda follows the measured noise and motion, block by block; `lambda` is not used
  double noise_k = 0.0;      // temporal noise for auto_lambda, kMmae and kMotion, K (counts like lambda); 0: measured
  int iterations = 0;        // ADMM, or sweeps of kDual; 0: as many as the accuracy needs at this lambda
  int lookahead = 0;         // L: the window ends L frames after the frame that is estimated
  Gyro* gyro = nullptr;      // for kMotion; outlives the solver. Null: none
  GyroSetup gyro_setup{};

  // lambda in units of 1/2 ||.||^2 + lambda ||D||_1.
  constexpr double half_square_lambda() const { return lambda / (2.0 * kappa); }
};

// Names every wrong value with its range. Thread: setup.
Status validate(const Settings& settings);

// Refuses a gyro with methods that cannot use one. Thread: setup.
Status check_gyro(const Settings& settings);

// T / tau above which a look-ahead is refused: the inputs before and after a frame's time then have little in common,
// and their mean would show both (a hand twice).
inline constexpr double kLongestRatioToLookAhead = 2.0;

// Tells users if so little of a frame remains in the next that deblurring hardly matters; else empty. Thread: setup.
std::string weak_inertia_warning(const Settings& settings);

struct StreamTask {
  Settings settings;
  StreamFormat input;
  PixelType output = PixelType::kUint16;
  double row_period = 0.0;   // from a stored row's sample to the next one's, frame periods
  double noise_floor = 0.0;  // least measured noise, values' unit; 0: that of rounding

  // Delay of a stored row's sample after the frame's time, frame periods.
  double row_delay(int row) const { return row * row_period; }
  bool delays_rows() const { return row_period != 0.0; }

  // Row y of a raw plane; NaN and values beyond any temperature are replaced by the value before.
  void load_row(const void* plane, int y, float* to) const noexcept;

  // Kelvin per unit of the values; camera counts are taken as 10 mK, as in the A655sc's linear modes.
  double kelvin_per_value() const;
  // A difference of values in the unit that users see: K, or counts.
  double in_kelvin(double value) const;
  // lambda / (2 kappa) in the units of the values.
  double lambda_half() const;
};

// lambda_half in K for which iterations are tuned: with automatic lambda, the largest that scenes get.
double lambda_to_tune(const StreamTask& task);

}  // namespace bolo::deblur
