// Noise of frames, rows, columns and single pixels.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {
namespace {

auto scale_noise(const EffectSetup& setup) {
  return [scale = setup.number("scale")](CameraModel& model) { model.noise_scale *= scale; };
}

auto spread_noise(const EffectSetup& setup) {
  return [degrees = setup.number("degrees")](CameraModel& model) { model.noise_degrees = degrees; };
}

// A common offset of all pixels, new in every frame.
class Flicker final : public Effect {
 public:
  explicit Flicker(const EffectSetup& setup)
      : sigma_k_(setup.number("sigma_k")),
        correlation_(setup.number("correlation")),
        seed_(setup.noise_seed()),
        state_(normal(key(seed_, 0))) {}

  void begin(const FrameInstant& frame) override {
    const double fresh = normal(seed_, static_cast<std::uint64_t>(frame.index));
    state_ = correlation_ * state_ + std::sqrt(1.0 - correlation_ * correlation_) * fresh;
  }

  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    for (double& k : kelvin) k += sigma_k_ * state_;
  }

 private:
  double sigma_k_;
  double correlation_;
  std::uint64_t seed_;
  double state_;  // unit variance from the first frame on
};

// A new offset for each column and row in every frame.
class Stripes final : public Effect {
 public:
  explicit Stripes(const EffectSetup& setup)
      : column_k_(setup.number("column_k")),
        row_k_(setup.number("row_k")),
        seed_(setup.noise_seed()),
        column_(static_cast<std::size_t>(setup.geometry().width)) {}

  void begin(const FrameInstant& frame) override {
    frame_ = static_cast<std::uint64_t>(frame.index);
    fill_normal(seed_, frame_, 0, column_);
  }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const double offset_k = row_k_ * normal(key(seed_, static_cast<std::uint64_t>(row)), frame_);
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += column_k_ * column_[x] + offset_k;
  }

 private:
  double column_k_;
  double row_k_;
  std::uint64_t seed_;
  std::uint64_t frame_ = 0;
  std::vector<double> column_;
};

// 1/f noise of each pixel, a sum of first-order noises of equal variance with geometrically spaced corners (Keshner,
// "1/f noise", Proceedings of the IEEE 1982): within 4 % of 1/f from 0.05 Hz to a quarter of the frame rate.
constexpr double kLowestHz = 0.02;
constexpr double kFactor = 3.0;
constexpr std::size_t kParts = 8;

class OneOverF final : public Effect {
 public:
  explicit OneOverF(const EffectSetup& setup) : seed_(setup.noise_seed()) {
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
    const std::size_t begin = static_cast<std::size_t>(row) * kelvin.size();
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
  // Uniform samples suffice: sums over many frames are approximately normal.
  static constexpr double kUniform = 3.4641016151377544;  // sqrt(12)
  struct Part {
    double keep = 0.0;
    double fresh = 0.0;
  };
  std::uint64_t seed_;
  std::array<Part, kParts> parts_;
  std::array<std::vector<double>, kParts> states_;
};

// The pixels (at least one) selected by an effect's fraction.
std::vector<std::size_t> chosen(const EffectSetup& setup) {
  const std::size_t size = setup.geometry().pixels();
  const double wanted = setup.number("fraction") * static_cast<double>(size);
  const auto count = wanted > 0.0 ? std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(wanted))) : 0;
  return choose(setup.pattern_seed(), size, count);
}

// Calls visit(pixel, its value) for those of `pixels` (sorted by place) that lie in the row.
template <typename Pixel, typename Visit>
void visit_row(std::vector<Pixel>& pixels, int row, std::span<double> kelvin, Visit visit) noexcept {
  const std::size_t begin = static_cast<std::size_t>(row) * kelvin.size();
  auto pixel = std::ranges::lower_bound(pixels, begin, {}, &Pixel::place);
  for (; pixel != pixels.end() && pixel->place < begin + kelvin.size(); ++pixel) {
    visit(*pixel, kelvin[pixel->place - begin]);
  }
}

// Random telegraph signal: pixels that jump between two levels.
class Rts final : public Effect {
 public:
  explicit Rts(const EffectSetup& setup)
      : step_k_(setup.number("step_k")),
        seed_(setup.noise_seed()),
        chance_(-0.5 * std::expm1(-2.0 * setup.number("rate_hz") * setup.period_s())) {
    for (const std::size_t place : chosen(setup)) pixels_.push_back({place, SplitMix(key(seed_, place)).chance(0.5)});
  }

  void row(const FrameInstant& frame, int row, std::span<double> kelvin) noexcept override {
    visit_row(pixels_, row, kelvin, [&](Pixel& pixel, double& k) {
      SplitMix random(key(key(seed_, pixel.place), static_cast<std::uint64_t>(frame.index)));
      if (random.chance(chance_)) pixel.high = !pixel.high;
      k += pixel.high ? step_k_ / 2.0 : -step_k_ / 2.0;
    });
  }

 private:
  struct Pixel {
    std::size_t place = 0;
    bool high = false;
  };
  double step_k_;
  std::uint64_t seed_;
  double chance_;  // of changing the level between two frames
  std::vector<Pixel> pixels_;
};

// Dead pixels: stuck at a level, or pure noise.
class DeadPixels final : public Effect {
 public:
  explicit DeadPixels(const EffectSetup& setup) : seed_(setup.noise_seed()) {
    SplitMix random(key(setup.pattern_seed(), 1));
    for (const std::size_t place : chosen(setup)) {
      const double level_k = random.between(280.0, 330.0);
      const double noise_k = random.between(10.0, 30.0) * setup.settings().readout.noise_k;
      const bool noisy = random.chance(0.5) ? !setup.form("stuck") : setup.form("noisy");
      pixels_.push_back({place, level_k, noisy ? noise_k : 0.0});
    }
  }

  void row(const FrameInstant& frame, int row, std::span<double> kelvin) noexcept override {
    visit_row(pixels_, row, kelvin, [&](const Pixel& pixel, double& k) {
      const double noise = normal(key(seed_, pixel.place), static_cast<std::uint64_t>(frame.index));
      k = pixel.level_k + pixel.noise_k * noise;
    });
  }

 private:
  struct Pixel {
    std::size_t place = 0;
    double level_k = 0.0;
    double noise_k = 0.0;
  };
  std::uint64_t seed_;
  std::vector<Pixel> pixels_;
};

}  // namespace

std::vector<EffectType> noise_effects() {
  return {
      EffectType("noise_level", Stage::kNoise, Order::kOffset, "the white noise is scaled",
                 {{"scale", "", 1.3, {0.1, 10.0}, {{1.12, 1.5}}, "of the stated rms"}}, {}, hooked(scale_noise)),
      EffectType("heavy_tail", Stage::kNoise, Order::kOffset, "the noise is Student's t, of the stated rms",
                 {{"degrees", "", 4.0, {2.1, 1000.0}, {{3.0, 6.0}}, "of freedom"}}, {}, hooked(spread_noise)),
      EffectType("flicker", Stage::kReadout, Order::kOffset, "the whole frame has a new offset every time",
                 {{"sigma_k", "K", 0.009, {0.0, 5.0}, {{0.004, 0.015}}, "rms of the offsets"},
                  {"correlation", "", 0.0, {0.0, 0.95}, {}, "of one frame's offset with the next one's"}},
                 {}, maker<Flicker>()),
      EffectType("stripes", Stage::kReadout, Order::kOffset, "each column and each row has a new offset in every frame",
                 {{"column_k", "K", 0.012, {0.0, 5.0}, {{0.006, 0.02}}, "rms of the columns'"},
                  {"row_k", "K", 0.006, {0.0, 5.0}, {{0.0, 0.015}}, "rms of the rows'"}},
                 {}, maker<Stripes>()),
      EffectType(
          "one_over_f", Stage::kPixel, Order::kOffset,
          "each pixel has 1/f noise: its spectrum meets that of the white noise at the corner",
          {{"corner_hz", "Hz", 3.0, {0.0, 100.0}, {{1.0, 6.0}}, "spectrum = white * corner / f, down to 0.05 Hz"}}, {},
          maker<OneOverF>()),
      EffectType("rts", Stage::kPixel, Order::kOffset, "some pixels jump between two levels",
                 {{"fraction", "", 0.01, {0.0, 0.5}, {{0.005, 0.02}}, "of the pixels, at least one"},
                  {"step_k", "K", 0.2, {0.0, 10.0}, {{0.1, 0.3}}, "between the levels"},
                  {"rate_hz", "1/s", 3.0, {0.0, 1000.0}, {{1.0, 6.0}}, "jumps a second"}},
                 {}, maker<Rts>()),
      EffectType("dead_pixels", Stage::kPixel, Order::kDefect,
                 "some pixels do not answer: stuck at a level, or noisy with 10 to 30 times the noise",
                 {{"fraction", "", 0.006, {0.0, 0.5}, {{0.003, 0.01}}, "of the pixels, at least one"}},
                 {"mixed", "stuck", "noisy"}, maker<DeadPixels>()),
  };
}

}  // namespace bolo::sim
