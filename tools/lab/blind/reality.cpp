// The camera of the second reality, stepped in time.
#include "tools/lab/blind/reality.hpp"

#include <algorithm>
#include <numeric>

namespace bolo::tools::blind::second {
namespace {

constexpr double kFrameS = 0.005;
constexpr double kTauS = 0.011;
constexpr double kNoiseK = 0.03;
constexpr double kCountK = 0.01;
constexpr double kGainCorrectedAtK = 298.15;

// temperature_of() for many values.
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

// The heat equation of all pixels by an explicit rule of third order, and its past.
class Array {
 public:
  Array(const Session& session, const Scene& scene, const Hidden& hidden, double begin_s)
      : scene_(scene),
        hidden_(hidden),
        g_(session.geometry),
        begin_s_(begin_s),
        input_(g_.pixels()),
        tau_(g_.pixels()) {
    Luck luck(session.camera_seed + 1);
    const double scale = hidden.number("tau_global", "scale", 1.0);
    const double spread = hidden.number("tau_spread", "rms", 0.0);
    const double turn = luck.even(0.0, kTwoPi);
    for (std::size_t p = 0; p < tau_.size(); ++p) {
      const double x = static_cast<double>(p % static_cast<std::size_t>(g_.width)) / g_.width - 0.5;
      const std::size_t row = p / static_cast<std::size_t>(g_.width);
      const double y = static_cast<double>(row) / g_.height - 0.5;
      const double smooth = std::sqrt(2.0) * std::sin(4.0 * (x * std::cos(turn) + y * std::sin(turn)) + turn);
      tau_[p] = 0.8 * luck.even(-1.732, 1.732) + 0.6 * smooth;
    }
    // A spread is one about the mean.
    const double mean = std::accumulate(tau_.begin(), tau_.end(), 0.0) / static_cast<double>(tau_.size());
    for (double& one : tau_) one = kTauS * scale * (1.0 + spread * (one - mean));
    scene_(begin_s, input_);
    fast_ = slow_ = input_;
    past_.assign(kPast, input_);
  }

  // Goes on until the state at `t_s` is known.
  void reach(double t_s) {
    while (begin_s_ + static_cast<double>(steps_) * kSubstepS < t_s) step();
  }

  // What a pixel shows at t, or on average over [t, t + window).
  double at(std::size_t pixel, double t_s, double window_s) const {
    if (window_s <= 0.0) return instant(pixel, t_s);
    constexpr int kPoints = 24;
    double sum = 0.0;
    for (int i = 0; i < kPoints; ++i) sum += instant(pixel, t_s + window_s * (i + 0.5) / kPoints);
    return sum / kPoints;
  }

 private:
  static constexpr std::size_t kPast = 128;

  double instant(std::size_t pixel, double t_s) const {
    const double place = (t_s - begin_s_) / kSubstepS;
    const double whole = std::floor(place);
    const auto i = static_cast<std::size_t>(std::max(0.0, whole));
    const double a = past_[i % kPast][pixel];
    return a + (place - whole) * (past_[(i + 1) % kPast][pixel] - a);
  }

  // from + part * dT/dt, with the derivative of `state`.
  void move(const Plane& from, const Plane& state, double part_s, Plane& to) const {
    const double coupling = hidden_.number("crosstalk", "coupling", 0.0);
    const bool diagonal = hidden_.has("crosstalk", "eight");
    const double falling = hidden_.number("tau_asymmetry", "scale", 1.0);
    for (int y = 0; y < g_.height; ++y) {
      for (int x = 0; x < g_.width; ++x) {
        const auto p = static_cast<std::size_t>(y * g_.width + x);
        double flow = input_[p] - state[p];
        for (int d = 0; coupling > 0.0 && d < 9; ++d) {
          const int ny = y + d / 3 - 1;
          const int nx = x + d % 3 - 1;
          const bool corner = ny != y && nx != x;
          if (ny < 0 || nx < 0 || ny >= g_.height || nx >= g_.width || (corner && !diagonal)) continue;
          const double k = corner ? coupling / 2.0 : coupling;
          flow += k * (state[static_cast<std::size_t>(ny * g_.width + nx)] - state[p]);
        }
        to[p] = from[p] + part_s * flow / (flow < 0.0 ? tau_[p] * falling : tau_[p]);
      }
    }
  }

  void step() {
    scene_(begin_s_ + static_cast<double>(steps_) * kSubstepS, input_);
    Plane third(fast_);
    Plane half(fast_);
    move(fast_, fast_, kSubstepS / 3.0, third);
    move(fast_, third, kSubstepS / 2.0, half);
    const Plane before = fast_;
    move(before, half, kSubstepS, fast_);
    const double share = hidden_.number("slow_pole", "share", 0.0);
    const double slow_s = hidden_.number("slow_pole", "slow_tau_s", 1.0);
    Plane& shown = past_[(++steps_) % kPast];
    for (std::size_t p = 0; p < fast_.size(); ++p) {
      const double h = kSubstepS / slow_s;
      slow_[p] += (h - h * h / 2.0) * (input_[p] - slow_[p]);
      shown[p] = fast_[p] + share * (slow_[p] - fast_[p]);
    }
  }

  const Scene& scene_;
  const Hidden& hidden_;
  Geometry g_;
  double begin_s_;
  std::size_t steps_ = 0;
  Plane input_, tau_, fast_, slow_;
  std::vector<Plane> past_;
};

// When each stored frame was truly taken: lost frames, another clock, jitter. A frame that repeats the one before has
// no time of its own: -1.
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
    // Five lost within a second.
    if (burst && k > middle && (k - middle) % 40 == 0 && k <= middle + 200) number += 1.0;
    const double off = jitter > 0.0 ? std::clamp(jitter * luck.normal(), -0.002, 0.002) : 0.0;
    times.push_back(number * period + off);
  }
  return times;
}

// From what the pixels show to counts.
class Readout {
 public:
  Readout(const Session& session, const CapturePlan& plan, const Hidden& hidden)
      : plan_(plan),
        hidden_(hidden),
        g_(session.geometry),
        luck_(plan.noise_seed),
        fixed_(session.camera_seed),
        gain_(g_.pixels(), 0.0),
        offset_(gain_),
        share_(gain_),
        thaw_(gain_),
        defect_(g_.pixels(), 0),
        level_(gain_),
        up_(g_.pixels(), 0) {
    fix_patterns();
    make_slow();
  }

  // `shown`: one plane, as the array gives it.
  void frame(std::size_t k, Plane shown, Plane& out) {
    const double t_s = static_cast<double>(k) * kFrameS;
    amplify(t_s, shown);
    add_noise(t_s, shown);
    filter(k, shown);
    firmware(k, t_s, shown);
    out = std::move(shown);
  }

 private:
  void fix_patterns() {
    const double gain = hidden_.number("fpn_gain", "rms", 0.0);
    const double pixel = hidden_.number("fpn_offset", "pixel_k", 0.0);
    const double column = hidden_.number("fpn_offset", "column_k", 0.0);
    const double dead = hidden_.number("dead_pixels", "fraction", 0.0);
    const double hopping = hidden_.number("rts", "fraction", 0.0);
    std::vector<double> columns(static_cast<std::size_t>(g_.width));
    for (double& one : columns) one = column * fixed_.normal();
    for (std::size_t p = 0; p < gain_.size(); ++p) {
      gain_[p] = gain * fixed_.even(-1.732, 1.732);
      offset_[p] = pixel * fixed_.normal() + columns[p % columns.size()];
      share_[p] = 1.0 + hidden_.number("drift", "spread", 0.0) * fixed_.normal();
      thaw_[p] = hidden_.number("nuc_freeze", "offset_k", 0.0) * fixed_.normal();
      level_[p] = fixed_.even(292.0, 312.0);
      if (fixed_.chance(dead)) defect_[p] = hidden_.has("dead_pixels", "silent") ? 1 : 2;
      if (fixed_.chance(hopping)) defect_[p] = 3;
    }
    if (dead > 0.0) defect_[gain_.size() / 2 + 5] = hidden_.has("dead_pixels", "silent") ? 1 : 2;
    if (hopping > 0.0) defect_[gain_.size() / 2 + 5] = defect_[gain_.size() / 3] = 3;
  }

  // Noise with a spectrum 1/f^exponent: relaxations an octave apart.
  void make_slow() {
    const double corner = hidden_.number("one_over_f", "corner_hz", 0.0);
    if (corner <= 0.0) return;
    const double exponent = hidden_.number("one_over_f", "exponent", 1.0);
    for (double tau_s = 0.002; tau_s < 40.0; tau_s *= 2.0) {
      const double at_hz = 1.0 / (kTwoPi * tau_s);
      const double variance =
          2.0 * kNoiseK * kNoiseK * kFrameS * corner * std::numbers::ln2 * std::pow(at_hz / corner, 1.0 - exponent);
      slow_.push_back({std::exp(-kFrameS / tau_s), std::sqrt(variance), {}});
      for (std::size_t p = 0; p < gain_.size(); ++p) slow_.back().state.push_back(slow_.back().sigma * luck_.normal());
    }
  }

  void amplify(double t_s, Plane& v) {
    const double drift_k = hidden_.number("drift", "amplitude_k", 0.0) *
                           std::tanh((plan_.session_start_s + t_s) / hidden_.number("drift", "time_s", 1.0));
    const double heat_k = hidden_.number("self_heating", "amplitude_k", 0.0);
    const double swing = hidden_.number("gain_drift", "amplitude", 0.0) * std::sin(kTwoPi * t_s / 2.2 + 1.0);
    const double hum = hidden_.number("mains_hum", "amplitude_k", 0.0) * std::sin(kTwoPi * 50.0 * 1.003 * t_s);
    const double smear = hidden_.number("column_crosstalk", "share", 0.0);
    for (std::size_t p = 0; p < v.size(); ++p) {
      const int row = static_cast<int>(p) / g_.width;
      if (hidden_.has("radiometric_nonlinearity")) v[p] = inverse().at(v[p]);
      v[p] += (gain_[p] + swing) * (v[p] - kGainCorrectedAtK) + offset_[p] + drift_k * share_[p];
      const double late = static_cast<double>(row) / g_.height;
      v[p] += heat_k * late / (late + 0.4) + (2 * row < g_.height ? hum : -hum);
    }
    for (std::size_t p = v.size(); smear > 0.0 && p-- > 0;) {
      if (p % static_cast<std::size_t>(g_.width) != 0) v[p] += smear * (v[p - 1] - v[p]);
    }
  }

  void add_noise(double t_s, Plane& v) {
    const double slow = hidden_.number("flicker", "correlation", 0.0);
    flicker_ =
        slow * flicker_ + std::sqrt(1.0 - slow * slow) * hidden_.number("flicker", "sigma_k", 0.0) * luck_.normal();
    std::vector<double> columns(static_cast<std::size_t>(g_.width), 0.0);
    std::vector<double> rows(static_cast<std::size_t>(g_.height), 0.0);
    for (double& one : columns) one = hidden_.number("stripes", "column_k", 0.0) * luck_.normal();
    for (double& one : rows) one = hidden_.number("stripes", "row_k", 0.0) * luck_.normal();
    const double degrees = hidden_.number("heavy_tail", "degrees", 0.0);
    std::chi_squared_distribution<double> chi(std::max(1.0, degrees));
    const double sigma = kNoiseK * hidden_.number("noise_level", "scale", 1.0);
    for (std::size_t p = 0; p < v.size(); ++p) {
      double noise = luck_.normal();
      if (degrees > 0.0) noise *= std::sqrt((degrees - 2.0) / chi(luck_.of));
      v[p] += sigma * noise + flicker_ + columns[p % columns.size()] + rows[p / columns.size()];
      for (Slow& one : slow_) {
        one.state[p] = one.keep * one.state[p] + std::sqrt(1.0 - one.keep * one.keep) * one.sigma * luck_.normal();
        v[p] += one.state[p];
      }
      if (defect_[p] == 1) v[p] = level_[p] + 3.0 * kNoiseK * luck_.normal();
      if (defect_[p] == 2) v[p] = level_[p];
      if (defect_[p] == 3) hop(p, v[p]);
      v[p] = std::min(v[p], hidden_.number("saturation", "level_k", 1e9));
      v[p] = std::max(v[p], hidden_.number("clipped_range", "level_k", 0.0));
    }
    if (hidden_.has("offset_jump") && t_s >= hidden_.number("offset_jump", "at_s", 0.0)) {
      for (double& one : v) one += hidden_.number("offset_jump", "jump_k", 0.0);
    }
  }

  // Longer at the lower level than at the upper one.
  void hop(std::size_t p, double& value) {
    const double rate = hidden_.number("rts", "rate_hz", 0.0) * kFrameS;
    if (luck_.chance(up_[p] != 0 ? 1.3 * rate : 0.8 * rate)) up_[p] = up_[p] != 0 ? 0 : 1;
    if (up_[p] != 0) value += hidden_.number("rts", "step_k", 0.0);
  }

  void filter(std::size_t k, Plane& v) {
    const double alpha = hidden_.number("iir", "alpha", 1.0);
    if (alpha < 1.0 && k > 0) {
      for (std::size_t p = 0; p < v.size(); ++p) v[p] = filtered_[p] + alpha * (v[p] - filtered_[p]);
    }
    filtered_ = v;
  }

  void firmware(std::size_t k, double t_s, Plane& v) {
    if (hidden_.has("nuc_freeze")) {
      const double from_s = hidden_.number("nuc_freeze", "at_s", 0.0);
      const double to_s = from_s + kFrameS * hidden_.number("nuc_freeze", "freeze_frames", 0.0);
      if (t_s >= from_s && t_s < to_s && k > 0) v = last_;
      for (std::size_t p = 0; t_s >= to_s && p < v.size(); ++p) v[p] += thaw_[p];
    }
    const Plane whole = v;
    if (k > 0 && luck_.chance(hidden_.number("torn_frames", "per_thousand", 0.0) / 1000.0)) {
      const auto cut = static_cast<std::size_t>(luck_.even(0.2, 0.8) * g_.height) * static_cast<std::size_t>(g_.width);
      std::copy(last_.begin() + static_cast<long>(cut), last_.end(), v.begin() + static_cast<long>(cut));
    }
    last_ = whole;
    const double step = hidden_.number("coarse_quantisation", "step_k", 0.0);
    for (double& one : v) one = step > 0.0 ? step * std::floor(one / step) : one;
  }

  static const Inverse& inverse() {
    static const Inverse one;
    return one;
  }

  struct Slow {
    double keep;
    double sigma;
    Plane state;
  };
  const CapturePlan& plan_;
  const Hidden& hidden_;
  Geometry g_;
  Luck luck_, fixed_;
  Plane gain_, offset_, share_, thaw_;
  std::vector<char> defect_;  // 1: silent but noisy, 2: stuck, 3: hops
  Plane level_;
  std::vector<char> up_;
  std::vector<Slow> slow_;
  double flicker_ = 0.0;
  Plane filtered_, last_;
};

// When a row is read after its frame's time.
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
  constexpr double kBeforeS = 1.5;  // the bench has been running
  const Hidden hidden{plan.effects};
  const Geometry g = session.geometry;
  const Scene scene = scene_of(plan, hidden, g);
  Array array(session, scene, hidden, std::holds_alternative<capture::BarTarget>(plan.stimulus) ? -kBeforeS : -0.02);
  Readout readout(session, plan, hidden);
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
