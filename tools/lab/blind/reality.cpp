// The camera of the second reality, stepped in time.
#include "tools/lab/blind/reality.hpp"

namespace bolo::tools::blind::second {
namespace {

constexpr double kFrameS = 0.005;
constexpr double kTauS = 0.011;
constexpr double kNoiseK = 0.03;
constexpr double kCountK = 0.01;
constexpr double kGainCorrectedAtK = 298.15;

// temperature_of() by table, for many values.
class Inverse {
 public:
  Inverse() {
    for (int i = 0; i <= kPoints; ++i) table_[static_cast<std::size_t>(i)] = temperature_of(240.0 + i * kStep);
  }
  double at(double radiance) const {
    const double s = std::clamp((radiance - 240.0) / kStep, 0.0, kPoints - 1e-9);
    const auto i = static_cast<std::size_t>(s);
    return table_[i] + (s - static_cast<double>(i)) * (table_[i + 1] - table_[i]);
  }

 private:
  static constexpr int kPoints = 12000;
  static constexpr double kStep = 0.01;
  std::array<double, kPoints + 1> table_{};
};

// The heat equation of all pixels by an explicit third-order Runge-Kutta method, with its history.
struct Array {
  const Scene& scene;
  const Hidden& hidden;
  Geometry g;
  double begin_s;
  std::size_t steps = 0;
  Plane input = Plane(g.pixels()), tau = input, fast{}, slow{};
  std::vector<Plane> past{};

  void begin(std::uint64_t camera_seed) {
    Luck luck(camera_seed + 1);
    const double scale = hidden.number("tau_global", "scale", 1.0);
    const double spread = hidden.number("tau_spread", "rms", 0.0);
    const double turn = luck.even(0.0, kTwoPi);
    for (std::size_t p = 0; p < tau.size(); ++p) {
      const double x = static_cast<double>(p % static_cast<std::size_t>(g.width)) / g.width - 0.5;
      const std::size_t row = p / static_cast<std::size_t>(g.width);
      const double y = static_cast<double>(row) / g.height - 0.5;
      const double smooth = std::sqrt(2.0) * std::sin(4.0 * (x * std::cos(turn) + y * std::sin(turn)) + turn);
      tau[p] = 0.8 * luck.even(-1.732, 1.732) + 0.6 * smooth;
    }
    // The spread is relative to the mean, and exact: the rms of the drawn piece of a wave would not be.
    const auto pixels = static_cast<double>(tau.size());
    const double mean = std::accumulate(tau.begin(), tau.end(), 0.0) / pixels;
    double square = 0.0;
    for (const double one : tau) square += (one - mean) * (one - mean) / pixels;
    for (double& one : tau) one = kTauS * scale * (1.0 + spread * (one - mean) / std::sqrt(square));
    scene(begin_s, input);
    fast = slow = input;
    past.assign(kPast, input);
  }

  void reach(double t_s) {
    while (begin_s + static_cast<double>(steps) * kSubstepS < t_s) step();
  }

  // A pixel's signal at t, or its mean over [t, t + window).
  double at(std::size_t pixel, double t_s, double window_s) const {
    if (window_s <= 0.0) return instant(pixel, t_s);
    constexpr int kPoints = 24;
    double sum = 0.0;
    for (int i = 0; i < kPoints; ++i) sum += instant(pixel, t_s + window_s * (i + 0.5) / kPoints);
    return sum / kPoints;
  }

  static constexpr std::size_t kPast = 128;

  double instant(std::size_t pixel, double t_s) const {
    const double place = (t_s - begin_s) / kSubstepS;
    const double whole = std::floor(place);
    const auto i = static_cast<std::size_t>(std::max(0.0, whole));
    const double a = past[i % kPast][pixel];
    return a + (place - whole) * (past[(i + 1) % kPast][pixel] - a);
  }

  // from + part * dT/dt, with the derivative at `state`.
  void move(const Plane& from, const Plane& state, double part_s, Plane& to) const {
    const double coupling = hidden.number("crosstalk", "coupling", 0.0);
    const bool diagonal = hidden.has("crosstalk", "eight");
    const double falling = hidden.number("tau_asymmetry", "scale", 1.0);
    for (int y = 0; y < g.height; ++y) {
      for (int x = 0; x < g.width; ++x) {
        const auto p = static_cast<std::size_t>(y * g.width + x);
        double flow = input[p] - state[p];
        for (int d = 0; coupling > 0.0 && d < 9; ++d) {
          const int ny = y + d / 3 - 1;
          const int nx = x + d % 3 - 1;
          const bool corner = ny != y && nx != x;
          if (ny < 0 || nx < 0 || ny >= g.height || nx >= g.width || (corner && !diagonal)) continue;
          const double k = corner ? coupling / 2.0 : coupling;
          flow += k * (state[static_cast<std::size_t>(ny * g.width + nx)] - state[p]);
        }
        to[p] = from[p] + part_s * flow / (flow < 0.0 ? tau[p] * falling : tau[p]);
      }
    }
  }

  void step() {
    scene(begin_s + static_cast<double>(steps) * kSubstepS, input);
    Plane third(fast);
    Plane half(fast);
    move(fast, fast, kSubstepS / 3.0, third);
    move(fast, third, kSubstepS / 2.0, half);
    const Plane before = fast;
    move(before, half, kSubstepS, fast);
    const double share = hidden.number("slow_pole", "share", 0.0);
    const double slow_s = hidden.number("slow_pole", "slow_tau_s", 1.0);
    Plane& shown = past[(++steps) % kPast];
    for (std::size_t p = 0; p < fast.size(); ++p) {
      const double h = kSubstepS / slow_s;
      slow[p] += (h - h * h / 2.0) * (input[p] - slow[p]);
      shown[p] = fast[p] + share * (slow[p] - fast[p]);
    }
  }
};

// True times of the stored frames, with lost frames, clock skew and jitter; -1: repeats the previous frame.
std::vector<double> frame_times(const CapturePlan& plan, const Hidden& hidden, Luck& luck) {
  const double rate = hidden.number("frame_loss", "per_thousand", 0.0) / 1000.0;
  const bool burst = hidden.has("frame_loss", "burst");
  const double period = kFrameS * (1.0 + hidden.number("clock_skew", "skew", 0.0));
  const double jitter = hidden.number("jitter", "rms_s", 0.0);
  const auto middle = static_cast<std::size_t>(luck.even(0.3, 0.6) * static_cast<double>(plan.frames));
  std::vector<double> times;
  double number = 0.0;
  for (std::size_t k = 0; k < plan.frames; ++k, number += 1.0) {
    const bool event = !burst && k > 2 && luck.chance(rate);
    if (event && luck.chance(0.5)) {
      times.push_back(-1.0);
      continue;
    }
    if (event) number += 1.0;
    // Five losses within a second.
    if (burst && k > middle && (k - middle) % 40 == 0 && k <= middle + 200) number += 1.0;
    const double off = jitter > 0.0 ? std::clamp(jitter * luck.normal(), -0.002, 0.002) : 0.0;
    times.push_back(number * period + off);
  }
  return times;
}

// The read-out, from the pixels' signals to counts.
struct Readout {
  struct Slow {
    double keep;
    double sigma;
    Plane state;
  };
  const CapturePlan& plan;
  const Hidden& hidden;
  Geometry g;
  Luck luck, fixed;
  Plane gain = Plane(g.pixels(), 0.0), offset = gain, share = gain, thaw = gain, level = gain;
  std::vector<char> defect = std::vector<char>(g.pixels(), 0);  // 1: silent but noisy, 2: stuck, 3: hops
  std::vector<char> up = defect;
  std::vector<Slow> slow{};
  double flicker = 0.0;
  Plane filtered{}, last{};

  // `shown`: one plane from the array.
  void frame(std::size_t k, Plane shown, Plane& out) {
    const double t_s = static_cast<double>(k) * kFrameS;
    amplify(t_s, shown);
    add_noise(t_s, shown);
    filter(k, shown);
    firmware(k, t_s, shown);
    out = std::move(shown);
  }

  void fix_patterns() {
    const double gain_rms = hidden.number("fpn_gain", "rms", 0.0);
    const double pixel = hidden.number("fpn_offset", "pixel_k", 0.0);
    const double column = hidden.number("fpn_offset", "column_k", 0.0);
    const double dead = hidden.number("dead_pixels", "fraction", 0.0);
    const double hopping = hidden.number("rts", "fraction", 0.0);
    std::vector<double> columns(static_cast<std::size_t>(g.width));
    for (double& one : columns) one = column * fixed.normal();
    for (std::size_t p = 0; p < gain.size(); ++p) {
      gain[p] = gain_rms * fixed.even(-1.732, 1.732);
      offset[p] = pixel * fixed.normal() + columns[p % columns.size()];
      share[p] = 1.0 + hidden.number("drift", "spread", 0.0) * fixed.normal();
      thaw[p] = hidden.number("nuc_freeze", "offset_k", 0.0) * fixed.normal();
      level[p] = fixed.even(292.0, 312.0);
      if (fixed.chance(dead)) defect[p] = hidden.has("dead_pixels", "silent") ? 1 : 2;
      if (fixed.chance(hopping)) defect[p] = 3;
    }
    if (dead > 0.0) defect[gain.size() / 2 + 5] = hidden.has("dead_pixels", "silent") ? 1 : 2;
    if (hopping > 0.0) defect[gain.size() / 2 + 5] = defect[gain.size() / 3] = 3;
  }

  // Noise with a spectrum 1/f^exponent: sum of relaxation processes an octave apart.
  void make_slow() {
    const double corner = hidden.number("one_over_f", "corner_hz", 0.0);
    if (corner <= 0.0) return;
    const double exponent = hidden.number("one_over_f", "exponent", 1.0);
    for (double tau_s = 0.002; tau_s < 40.0; tau_s *= 2.0) {
      const double at_hz = 1.0 / (kTwoPi * tau_s);
      const double variance =
          2.0 * kNoiseK * kNoiseK * kFrameS * corner * std::numbers::ln2 * std::pow(at_hz / corner, 1.0 - exponent);
      slow.push_back({std::exp(-kFrameS / tau_s), std::sqrt(variance), {}});
      for (std::size_t p = 0; p < gain.size(); ++p) slow.back().state.push_back(slow.back().sigma * luck.normal());
    }
  }

  void amplify(double t_s, Plane& v) {
    const double drift_k = hidden.number("drift", "amplitude_k", 0.0) *
                           std::tanh((plan.session_start_s + t_s) / hidden.number("drift", "time_s", 1.0));
    const double heat_k = hidden.number("self_heating", "amplitude_k", 0.0);
    const double swing = hidden.number("gain_drift", "amplitude", 0.0) * std::sin(kTwoPi * t_s / 2.2 + 1.0);
    const double hum = hidden.number("mains_hum", "amplitude_k", 0.0) * std::sin(kTwoPi * 50.0 * 1.003 * t_s);
    const double smear = hidden.number("column_crosstalk", "share", 0.0);
    for (std::size_t p = 0; p < v.size(); ++p) {
      const int row = static_cast<int>(p) / g.width;
      if (hidden.has("radiometric_nonlinearity")) v[p] = inverse().at(v[p]);
      v[p] += (gain[p] + swing) * (v[p] - kGainCorrectedAtK) + offset[p] + drift_k * share[p];
      const double late = static_cast<double>(row) / g.height;
      v[p] += heat_k * late / (late + 0.4) + (2 * row < g.height ? hum : -hum);
    }
    for (std::size_t p = v.size(); smear > 0.0 && p-- > 0;) {
      if (p % static_cast<std::size_t>(g.width) != 0) v[p] += smear * (v[p - 1] - v[p]);
    }
  }

  void add_noise(double t_s, Plane& v) {
    const double keep = hidden.number("flicker", "correlation", 0.0);
    flicker = keep * flicker + std::sqrt(1.0 - keep * keep) * hidden.number("flicker", "sigma_k", 0.0) * luck.normal();
    std::vector<double> columns(static_cast<std::size_t>(g.width), 0.0);
    std::vector<double> rows(static_cast<std::size_t>(g.height), 0.0);
    for (double& one : columns) one = hidden.number("stripes", "column_k", 0.0) * luck.normal();
    for (double& one : rows) one = hidden.number("stripes", "row_k", 0.0) * luck.normal();
    const double degrees = hidden.number("heavy_tail", "degrees", 0.0);
    std::chi_squared_distribution<double> chi(std::max(1.0, degrees));
    const double sigma = kNoiseK * hidden.number("noise_level", "scale", 1.0);
    for (std::size_t p = 0; p < v.size(); ++p) {
      double noise = luck.normal();
      if (degrees > 0.0) noise *= std::sqrt((degrees - 2.0) / chi(luck.of));
      v[p] += sigma * noise + flicker + columns[p % columns.size()] + rows[p / columns.size()];
      for (Slow& one : slow) {
        one.state[p] = one.keep * one.state[p] + std::sqrt(1.0 - one.keep * one.keep) * one.sigma * luck.normal();
        v[p] += one.state[p];
      }
      if (defect[p] == 1) v[p] = level[p] + 3.0 * kNoiseK * luck.normal();
      if (defect[p] == 2) v[p] = level[p];
      if (defect[p] == 3) hop(p, v[p]);
      v[p] = std::min(v[p], hidden.number("saturation", "level_k", 1e9));
      v[p] = std::max(v[p], hidden.number("clipped_range", "level_k", 0.0));
    }
    if (hidden.has("offset_jump") && t_s >= hidden.number("offset_jump", "at_s", 0.0)) {
      for (double& one : v) one += hidden.number("offset_jump", "jump_k", 0.0);
    }
  }

  // Random telegraph noise, which stays longer at the lower level.
  void hop(std::size_t p, double& value) {
    const double rate = hidden.number("rts", "rate_hz", 0.0) * kFrameS;
    if (luck.chance(up[p] != 0 ? 1.3 * rate : 0.8 * rate)) up[p] = up[p] != 0 ? 0 : 1;
    if (up[p] != 0) value += hidden.number("rts", "step_k", 0.0);
  }

  void filter(std::size_t k, Plane& v) {
    const double alpha = hidden.number("iir", "alpha", 1.0);
    if (alpha < 1.0 && k > 0) {
      for (std::size_t p = 0; p < v.size(); ++p) v[p] = filtered[p] + alpha * (v[p] - filtered[p]);
    }
    filtered = v;
  }

  void firmware(std::size_t k, double t_s, Plane& v) {
    if (hidden.has("nuc_freeze")) {
      const double from_s = hidden.number("nuc_freeze", "at_s", 0.0);
      const double to_s = from_s + kFrameS * hidden.number("nuc_freeze", "freeze_frames", 0.0);
      if (t_s >= from_s && t_s < to_s && k > 0) v = last;
      for (std::size_t p = 0; t_s >= to_s && p < v.size(); ++p) v[p] += thaw[p];
    }
    const Plane whole = v;
    if (k > 0 && luck.chance(hidden.number("torn_frames", "per_thousand", 0.0) / 1000.0)) {
      const auto cut = static_cast<std::size_t>(luck.even(0.2, 0.8) * g.height) * static_cast<std::size_t>(g.width);
      std::copy(last.begin() + static_cast<long>(cut), last.end(), v.begin() + static_cast<long>(cut));
    }
    last = whole;
    const double step = hidden.number("coarse_quantisation", "step_k", 0.0);
    for (double& one : v) one = step > 0.0 ? step * std::floor(one / step) : one;
  }

  static const Inverse& inverse() {
    static const Inverse one;
    return one;
  }
};

// Delay of a row's read-out after its frame's time.
double row_time(const Hidden& hidden, int row, int height) {
  if (hidden.has("split_readout")) {
    const int from_end = std::min(row, height - 1 - row);
    return hidden.number("split_readout", "row_delay_s", 0.0) * from_end;
  }
  const double delay = hidden.number("row_delay", "row_delay_s", 0.0);
  return delay >= 0.0 ? delay * row : -delay * (height - 1 - row);  // from the top, or from the bottom
}

}  // namespace

std::vector<std::uint16_t> film(const Session& session, const CapturePlan& plan) {
  constexpr double kBeforeS = 1.5;  // the bench starts this long before the first frame
  const Hidden hidden{plan.effects};
  const Geometry g = session.geometry;
  const Scene scene = scene_of(plan, hidden, g);
  Array array{scene, hidden, g, std::holds_alternative<capture::BarTarget>(plan.stimulus) ? -kBeforeS : -0.02};
  array.begin(session.camera_seed);
  Readout readout{plan, hidden, g, Luck(plan.noise_seed), Luck(session.camera_seed)};
  readout.fix_patterns();
  readout.make_slow();
  Luck luck(plan.noise_seed + 7);
  const double window_s = hidden.number("integration_window", "window_s", 0.0);
  std::vector<std::uint16_t> counts;
  Plane shown(g.pixels());
  Plane out;
  const std::vector<double> times = frame_times(plan, hidden, luck);
  for (std::size_t k = 0; k < times.size(); ++k) {
    if (times[k] >= 0.0 || k == 0) {
      const double t_s = times[k];
      array.reach(t_s + std::max(row_time(hidden, 0, g.height), row_time(hidden, g.height - 1, g.height)) + window_s +
                  2.0 * kSubstepS + row_time(hidden, g.height / 2, g.height));
      for (std::size_t p = 0; p < shown.size(); ++p) {
        shown[p] = array.at(p, t_s + row_time(hidden, static_cast<int>(p) / g.width, g.height), window_s);
      }
      readout.frame(k, shown, out);
    }
    for (const double kelvin : out) {
      counts.push_back(static_cast<std::uint16_t>(std::clamp(std::floor(kelvin / kCountK + 1e-9), 0.0, 65535.0)));
    }
  }
  return counts;
}

}  // namespace bolo::tools::blind::second
