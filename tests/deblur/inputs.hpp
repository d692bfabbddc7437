// Windows of samples for tests, tuning and benchmarks: one pixel under moving scenes, noise and defects.
#pragma once

#include "tests/test.hpp"

namespace bolo::deblur::testing {

enum class Input { kSteps, kNoise, kPulses, kSpikes, kPan, kSaturated, kConstant, kWaves, kTexture };

// All but waves and texture, which have ties at slow cameras.
inline constexpr Input kInputs[] = {Input::kSteps, Input::kNoise,     Input::kPulses,  Input::kSpikes,
                                    Input::kPan,   Input::kSaturated, Input::kConstant};

constexpr std::string_view name(Input input) {
  constexpr std::string_view kNames[] = {"steps",     "noise",    "pulses", "spikes", "pan",
                                         "saturated", "constant", "waves",  "texture"};
  return kNames[static_cast<int>(input)];
}

// One pixel's samples in K, as from a camera with 10 mK a count and a range of 0 to 655.35 K.
class InputSource {
 public:
  InputSource(int slots, double ratio, std::uint32_t seed) : slots_(slots), ratio_(ratio), random_(seed) {}

  std::vector<double> pixel(Input input) {
    std::vector<double> y(static_cast<std::size_t>(slots_), 300.0);
    switch (input) {
      case Input::kSteps:
        y = blurred(step(), 0.03);
        break;
      case Input::kNoise:
        add_noise(y, 20.0);
        break;  // 20 K white noise
      case Input::kPulses:
        y = blurred(pulse(), 0.03);
        break;
      case Input::kSpikes:
        y[pick(slots_)] += 300.0;
        break;  // a defect, not a scene: an outlier in one sample
      case Input::kPan:
        y = blurred(pan(), 0.03);
        break;
      case Input::kSaturated:
        for (double& value : y) value = uniform(0.0, 1.0) < 0.5 ? 0.0 : 655.35;
        break;
      case Input::kConstant:
        std::fill(y.begin(), y.end(), uniform(250.0, 400.0));
        break;
      case Input::kWaves:
        y = blurred(waves(), 0.03);
        break;
      case Input::kTexture:
        y = scene(300.0);
        add_noise(y, 20.0);
        y = blurred(y, 0.03);
        break;
    }
    for (double& value : y) value = std::clamp(std::round(value * 100.0), 0.0, 65535.0) / 100.0;
    return y;
  }

  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  std::size_t pick(int count) { return static_cast<std::size_t>(std::uniform_int_distribution(0, count - 1)(random_)); }

 private:
  static constexpr int kBefore = 40;  // frames before the window: it begins in the middle of the scene

  std::vector<double> scene(double value) const {
    return std::vector<double>(static_cast<std::size_t>(slots_ + kBefore), value);
  }

  std::vector<double> step() {
    std::vector<double> x = scene(300.0);
    const double height = uniform(-30.0, 30.0);
    for (std::size_t i = static_cast<std::size_t>(kBefore - 2) + pick(slots_ + 2); i < x.size(); ++i) x[i] += height;
    return x;
  }

  std::vector<double> pulse() {
    std::vector<double> x = scene(300.0);
    x[static_cast<std::size_t>(kBefore) + pick(slots_)] += uniform(0.0, 1.0) < 0.5 ? 300.0 : -290.0;
    return x;
  }

  // Constant stretches and steps, like passing edges of a street: every other frame a step of 1.5 K rms, sometimes 8 K.
  std::vector<double> pan() {
    std::vector<double> x = scene(300.0);
    std::normal_distribution<double> change(0.0, 1.5);
    for (std::size_t i = 1; i < x.size(); ++i) {
      const double u = uniform(0.0, 1.0);
      x[i] = x[i - 1] + (u < 0.5 ? change(random_) : u < 0.6 ? 5.0 * change(random_) : 0.0);
    }
    return x;
  }

  // A facade that passes by, 10 K up and down in 20 frames: slow to converge.
  std::vector<double> waves() {
    std::vector<double> x = scene(300.0);
    const double phase = uniform(0.0, 2.0 * std::numbers::pi);
    for (std::size_t i = 0; i < x.size(); ++i) {
      x[i] += 10.0 * std::sin(phase + 2.0 * std::numbers::pi * static_cast<double>(i) / 20.0);
    }
    return x;
  }

  std::vector<double> blurred(const std::vector<double>& x, double noise) {
    const double decay = std::exp(-ratio_);
    std::vector<double> y;
    double state = x.front();
    for (std::size_t i = 0; i < x.size(); ++i) {
      state = decay * state + (1.0 - decay) * x[i];
      if (i >= kBefore) y.push_back(state);
    }
    add_noise(y, noise);
    return y;
  }

  void add_noise(std::vector<double>& y, double sigma) {
    std::normal_distribution<double> noise(0.0, sigma);
    for (double& value : y) value += noise(random_);
  }

  int slots_;
  double ratio_;
  std::mt19937 random_;
};

}  // namespace bolo::deblur::testing
