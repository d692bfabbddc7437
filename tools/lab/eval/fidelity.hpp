// The table of `bolo-lab eval fidelity`: every estimator, and a filter that is told the motion, on the same targets of
// one sequence; and how it is drawn. Figures are JSON as the verb prints it: the schema is in its --help.
#pragma once

#include <array>

#include <Eigen/Core>

#include "src/deblur/solver.hpp"
#include "src/report/plot.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {

struct Column {
  const char* name;                // in JSON
  const char* words;               // in the picture and the head
  std::optional<plot::Hue> hue{};  // of its line in the picture; none: not drawn
  double width = 2.0;              // of that line: those below show beneath
};

inline constexpr std::array<Column, 9> kColumns{{
    {"blurred", "blurred"},
    {"inverse", "inverse filter", plot::Hue::kAmber, 6.5},
    {"qp_authors", "QP, the authors' lambda 0.1"},
    {"qp_best", "QP, best lambda", plot::Hue::kPurple, 4.5},
    {"auto", "QP, lambda auto", plot::Hue::kDeblurred, 2.5},
    {"mmae", "mmae", plot::Hue::kGreen},
    {"motion", "motion", plot::Hue::kBad},
    {"spatial_wiener", "told Wiener", plot::Hue::kSoft},
    {"spatial_wiener_10", "told 10 % too much speed"},
}};

// kappa 0.1; in units of half squares they are 0.001 to 2.
inline constexpr std::array<double, 13> kLambdas{0.0002, 0.0005, 0.001, 0.002, 0.004, 0.007, 0.01,
                                                 0.02,   0.04,   0.07,  0.1,   0.2,   0.4};
inline constexpr double kAuthorsLambda = 0.1;

// The settings of a method as the table runs it; kAdmm for the QP.
deblur::Settings settings_of(deblur::Method method, int lookahead, double lambda = kAuthorsLambda);

// Estimates of every target, judged part, K. The solver sees the frames before them in order, as in a live stream.
// kBadInput when Solver::create refuses the settings. Thread: any, several at once.
Result<Planes> estimate(const Sequence& sequence, const deblur::Settings& settings);

// Columns of those that know only the frame itself: they are the same at every look-ahead, and made once. Thread: any,
// several at once.
Json spatial_columns(const Sequence& sequence);

// The cell at one look-ahead, without the spatial columns. Thread: any, several at once.
Result<Json> evaluate(const Sequence& sequence, int lookahead);

// For each scene and motion a row of panels, one a noise: RMSE over latency. Thread: any.
plot::Sheet sheet_of(const Json& cells);

// --- A spatial filter that knows the blur.

// Blur as a sum: blurred(x, y) = sum of weight * sharp(x + dx, y + dy). The weights sum to 1.
struct Tap {
  int dx = 0;
  int dy = 0;
  float weight = 0.0F;
};

// The trail exp(-s / (v tau)) that thermal inertia leaves behind what moves over the pixels at a steady velocity, with
// the picture linear between pixels. Thread: any.
std::vector<Tap> motion_kernel(sim::Position content_px_s, double tau_s);

// The same for the way that the camera really went before `t_s`; `factor` stretches the trail: 1.1 for a speed that is
// thought 10 % too high. The path must go back 6 tau_s before. Thread: any.
std::vector<Tap> path_kernel(const sim::Path& path, double t_s, double tau_s, double factor = 1.0);

// Spatial Wiener filter with the known blur H: conj(H) / (|H|^2 + noise_to_signal * (f^2 + f0^2) / f0^2), for pictures
// whose power falls as 1 / (f^2 + f0^2), f0 = 1/64 cycles a pixel. Borders are joined by a smooth ramp. The transform
// of the picture is shared by all strengths. Thread: any, one object each.
class SpatialWiener {
 public:
  SpatialWiener(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel);
  Plane restore(double noise_to_signal) const;

 private:
  using Spectrum = Eigen::MatrixXcf;
  static void transform(Spectrum& spectrum, bool back);

  Geometry geometry_;
  Geometry padded_;
  double mean_ = 0.0;
  Spectrum image_;
  Spectrum kernel_;
};

// Keeps the best of several tries by their RMSE; the truth picks: the best that they can do, which nobody knows outside
// a simulator.
class Oracle {
 public:
  explicit Oracle(const Planes& truth) : truth_(truth) {}
  void offer(Planes tried, std::string setting);
  const Planes& planes() const { return planes_; }         // every target, judged part
  const std::string& setting() const { return setting_; }  // "lambda 0.01"

 private:
  const Planes& truth_;
  Planes planes_;
  std::string setting_;
  double error_ = 0.0;
};

// Offers the targets, each restored with the kernel that is told of it, at every strength. Thread: any, several at
// once.
void try_wiener(const Sequence& sequence, const std::vector<std::vector<Tap>>& kernels, Oracle& oracle);

inline constexpr double kWrongSpeed = 1.1;  // what the spatial filter is told where it is told wrongly

}  // namespace bolo::tools::fidelity
