// Each pixel's own slow noise.
#include <array>
#include <cmath>
#include <numbers>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

// 1/f as a sum of first-order noises of one variance, their corners a constant factor apart (Keshner, "1/f noise",
// Proceedings of the IEEE 1982): within 4 % of 1/f from 0.05 Hz to a quarter of the frame rate.
constexpr double kLowestHz = 0.02;
constexpr double kFactor = 3.0;
constexpr std::size_t kParts = 8;

class OneOverF final : public Effect {
 public:
  explicit OneOverF(const EffectSetup& setup)
      : width_(static_cast<std::size_t>(setup.geometry().width)), seed_(setup.noise_seed()) {
    // The white noise's spectral density is 2 noise^2 / rate; a first-order noise of variance v and corner c has
    // (2 v / pi) c / (c^2 + f^2), and the sum over corners a factor r apart v / (f ln r).
    const double white = 2.0 * setup.settings().readout.noise_k * setup.settings().readout.noise_k * setup.period_s();
    const double rms = std::sqrt(white * setup.number("corner_hz") * std::log(kFactor));
    double corner_hz = kLowestHz;
    for (Part& part : parts_) {
      part.keep = std::exp(-2.0 * std::numbers::pi * corner_hz * setup.period_s());
      part.fresh = rms * std::sqrt(1.0 - part.keep * part.keep) * kUniform;
      corner_hz *= kFactor;
    }
    for (std::size_t i = 0; i < kParts; ++i) {
      states_[i] = normal_plane(key(key(seed_, 1), i), setup.geometry());
      for (double& state : states_[i]) state *= rms;
    }
  }

  void row(const FrameInstant& frame, int row, std::span<double> kelvin) noexcept override {
    const std::size_t begin = static_cast<std::size_t>(row) * width_;
    SplitMix random(key(key(seed_, static_cast<std::uint64_t>(frame.index)), static_cast<std::uint64_t>(row)));
    for (std::size_t x = 0; x < kelvin.size(); ++x) {
      double sum = 0.0;
      std::uint64_t bits = 0;
      for (std::size_t i = 0; i < kParts; ++i) {
        if (i % 4 == 0) bits = random.next();
        const double uniform = static_cast<double>((bits >> (16 * (i % 4))) & 0xffffU) * 0x1p-16 + 0x1p-17 - 0.5;
        double& state = states_[i][begin + x];
        state = parts_[i].keep * state + parts_[i].fresh * uniform;
        sum += state;
      }
      kelvin[x] += sum;
    }
  }

 private:
  // What is fresh may be uniform: sums over many frames are normal all the same.
  static constexpr double kUniform = 3.4641016151377544;  // sqrt(12)
  struct Part {
    double keep = 0.0;
    double fresh = 0.0;
  };
  std::size_t width_;
  std::uint64_t seed_;
  std::array<Part, kParts> parts_;
  std::array<std::vector<double>, kParts> states_;
};

}  // namespace

EffectType one_over_f() {
  return {{"one_over_f",
           Stage::kPixel,
           true,
           "each pixel has 1/f noise: its spectrum meets that of the white noise at the corner",
           {{"corner_hz", "Hz", 3.0, {0.0, 100.0}, {{1.0, 6.0}}, "spectrum = white * corner / f, down to 0.05 Hz"}},
           {}},
          Order::kOffset,
          maker<OneOverF>()};
}

}  // namespace bolo::sim::effects
