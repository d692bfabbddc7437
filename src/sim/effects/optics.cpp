// The radiation's path to the pixels: emission, blur, ghosts, shading.
#include <algorithm>
#include <array>
#include <cmath>

#include "src/sim/effect_type.hpp"
#include "src/sim/radiance.hpp"

namespace bolo::sim {
namespace {

// The scene emits less than a black body and reflects its surroundings.
auto grey_body(const EffectSetup& setup) {
  const double e = setup.number("emissivity");
  const double reflected = radiance_of(setup.number("surroundings_k"));
  KelvinTable apparent([=](double k) { return temperature_of(e * radiance_of(k) + (1.0 - e) * reflected); });
  return [apparent = std::move(apparent)](std::unique_ptr<View> inner, const CameraModel&) {
    return point_view(std::move(inner), [&apparent](float kelvin, double, int) {
      return static_cast<float>(apparent(static_cast<double>(kelvin)));
    });
  };
}

// The pixel is linear in radiance, while the output is a temperature.
class RadiometricNonlinearity final : public Effect {
 public:
  explicit RadiometricNonlinearity(const EffectSetup&) {}
  void configure(CameraModel& model) override { model.radiance = true; }
  std::unique_ptr<View> filter_view(std::unique_ptr<View> inner, const CameraModel&) const override {
    return point_view(std::move(inner), [](float kelvin, double, int) {
      return static_cast<float>(radiance_of(static_cast<double>(kelvin)));
    });
  }
};

constexpr int kPhases = 8;  // samples per pixel along x, because the scene's edges are finer than its pixels

// Blur weights by row, from `-reach` to `reach`; within a row samples 1 / kPhases pixel apart, from -reach pixels on.
struct Kernel {
  int reach = 0;
  std::vector<double> down;                 // weight of each row, if all rows share one profile
  std::vector<std::vector<float>> profile;  // along x: one, or one per row
};

std::size_t taps(int reach) { return static_cast<std::size_t>(2 * reach * kPhases + 1); }

double tap_x(std::size_t tap, int reach) { return static_cast<double>(tap) / kPhases - reach; }

void normalise(Kernel& kernel) {
  double sum = 0.0;
  for (const auto& row : kernel.profile) {
    for (const float weight : row) sum += static_cast<double>(weight);
  }
  for (auto& row : kernel.profile) {
    for (float& weight : row) weight = static_cast<float>(static_cast<double>(weight) / sum);
  }
}

// Sampled one pixel apart, a Gaussian has too little variance: finds the sigma that yields the requested one.
std::vector<double> rows_of_variance(double variance, int reach) {
  std::vector<double> weights(static_cast<std::size_t>(2 * reach + 1));
  double low = 1e-3;
  double high = 2.0 * std::sqrt(variance) + 1.0;
  for (int i = 0; i < 60; ++i) {
    const double sigma = (low + high) / 2.0;
    double sum = 0.0;
    double square = 0.0;
    for (int y = -reach; y <= reach; ++y) {
      double& weight = weights[static_cast<std::size_t>(y + reach)];
      weight = std::exp(-0.5 * y * y / (sigma * sigma));
      sum += weight;
      square += weight * y * y;
    }
    for (double& weight : weights) weight /= sum;
    (square / sum < variance ? low : high) = sigma;
  }
  return weights;
}

Kernel gaussian(double sigma) {
  Kernel kernel;
  kernel.reach = static_cast<int>(std::ceil(4.0 * sigma));
  kernel.down = rows_of_variance(sigma * sigma, kernel.reach);
  kernel.profile.resize(1);
  for (std::size_t i = 0; i < taps(kernel.reach); ++i) {
    const double x = tap_x(i, kernel.reach) / sigma;
    kernel.profile[0].push_back(static_cast<float>(std::exp(-0.5 * x * x)));
  }
  normalise(kernel);
  return kernel;
}

// Length of the disc's vertical chord at x within the row y - 0.5 to y + 0.5.
double chord(double radius, double x, double y) {
  if (std::abs(x) >= radius) return 0.0;
  const double half = std::sqrt(radius * radius - x * x);
  return std::max(0.0, std::min(half, y + 0.5) - std::max(-half, y - 0.5));
}

Kernel disc(double radius) {
  Kernel kernel;
  kernel.reach = static_cast<int>(std::ceil(radius));
  constexpr int kFine = 16;  // the weight of a tap is the mean over its width
  for (int y = -kernel.reach; y <= kernel.reach; ++y) {
    auto& row = kernel.profile.emplace_back();
    for (std::size_t i = 0; i < taps(kernel.reach); ++i) {
      double sum = 0.0;
      for (int j = 0; j < kFine; ++j) {
        sum += chord(radius, tap_x(i, kernel.reach) + ((j + 0.5) / kFine - 0.5) / kPhases, y);
      }
      row.push_back(static_cast<float>(sum));
    }
  }
  normalise(kernel);
  return kernel;
}

class BlurredView final : public View {
 public:
  BlurredView(std::unique_ptr<View> inner, const Kernel& kernel) : inner_(std::move(inner)), kernel_(kernel) {}

  void draw(double t_s, const Patch& patch, std::span<float> out) override {
    const int reach = kernel_.reach;
    const Patch wide{patch.column - reach, patch.row - reach, patch.width + 2 * reach, patch.height + 2 * reach};
    for (std::size_t phase = 0; phase < kPhases; ++phase) {
      Patch shifted = wide;
      shifted.column += static_cast<double>(phase) / kPhases;
      phases_[phase].resize(wide.points());
      inner_->draw(t_s, shifted, phases_[phase]);
    }
    const auto width = static_cast<std::size_t>(patch.width);
    std::ranges::fill(out, 0.0F);
    if (kernel_.down.empty()) {
      for (int y = 0; y < patch.height; ++y) {
        for (int dy = 0; dy <= 2 * reach; ++dy) {
          add_row(y + dy, kernel_.profile[static_cast<std::size_t>(dy)], row_of(out, y, width));
        }
      }
      return;
    }
    across_.assign(static_cast<std::size_t>(wide.height) * width, 0.0F);
    for (int y = 0; y < wide.height; ++y) add_row(y, kernel_.profile[0], row_of(across_, y, width));
    for (int y = 0; y < patch.height; ++y) {
      const std::span<float> target = row_of(out, y, width);
      for (int dy = 0; dy <= 2 * reach; ++dy) {
        const auto weight = static_cast<float>(kernel_.down[static_cast<std::size_t>(dy)]);
        const std::span<const float> source = row_of(across_, y + dy, width);
        for (std::size_t x = 0; x < target.size(); ++x) target[x] += weight * source[x];
      }
    }
  }

  // Edges blurred over a pixel are far smoother than bare ones.
  double patience() const override { return 4.0 * inner_->patience(); }

 private:
  // Adds the contribution of row `y` of the wide patch through one profile.
  void add_row(int y, const std::vector<float>& profile, std::span<float> target) const {
    const std::size_t width = target.size() + static_cast<std::size_t>(2 * kernel_.reach);
    for (std::size_t tap = 0; tap < profile.size(); ++tap) {
      if (profile[tap] == 0.0F) continue;
      const float* const source = phases_[tap % kPhases].data() + static_cast<std::size_t>(y) * width + tap / kPhases;
      for (std::size_t x = 0; x < target.size(); ++x) target[x] += profile[tap] * source[x];
    }
  }

  std::unique_ptr<View> inner_;
  const Kernel& kernel_;
  std::array<std::vector<float>, kPhases> phases_;
  std::vector<float> across_;
};

class OpticalPsf final : public Effect {
 public:
  explicit OpticalPsf(const EffectSetup& setup)
      : blur_{setup.number("sigma_px"), setup.form("disc")},
        kernel_(blur_.disc ? disc(2.0 * blur_.sigma_px) : gaussian(blur_.sigma_px)) {}
  std::unique_ptr<View> filter_view(std::unique_ptr<View> inner, const CameraModel&) const override {
    if (std::unique_ptr<View> exact = inner->blurred(blur_)) return exact;
    return std::make_unique<BlurredView>(std::move(inner), kernel_);
  }

 private:
  Blur blur_;
  Kernel kernel_;
};

// The lens transmits less towards the corners, and emits the difference at its own temperature.
auto darken_corners(const EffectSetup& setup) {
  const double x0 = (setup.geometry().width - 1) / 2.0;
  const double y0 = (setup.geometry().height - 1) / 2.0;
  const double corner = x0 * x0 + y0 * y0;
  const double bend = corner > 0.0 ? setup.number("corner_loss") / corner : 0.0;
  return [=, kelvin = setup.number("reference_k")](std::unique_ptr<View> inner, const CameraModel& model) {
    const double own = model.radiance ? radiance_of(kelvin) : kelvin;
    return point_view(std::move(inner), [=](float signal, double x, int y) {
      const double square = (x - x0) * (x - x0) + (y - y0) * (y - y0);
      return static_cast<float>(static_cast<double>(signal) - bend * square * (static_cast<double>(signal) - own));
    });
  };
}

class GhostView final : public View {
 public:
  GhostView(std::unique_ptr<View> inner, Geometry frame, double share, bool mirrored, double shift_px)
      : inner_(std::move(inner)),
        frame_(frame),
        share_(static_cast<float>(share)),
        mirrored_(mirrored),
        shift_px_(shift_px) {}

  void draw(double t_s, const Patch& patch, std::span<float> out) override {
    inner_->draw(t_s, patch, out);
    Patch other = patch;
    if (mirrored_) {  // point reflection about the frame's centre
      other.column = frame_.width - patch.width - patch.column;
      other.row = frame_.height - patch.height - patch.row;
    } else {
      other.column -= shift_px_;
    }
    ghost_.resize(patch.points());
    inner_->draw(t_s, other, ghost_);
    if (mirrored_) std::ranges::reverse(ghost_);
    for (std::size_t i = 0; i < ghost_.size(); ++i) out[i] += share_ * (ghost_[i] - out[i]);
  }
  double patience() const override { return inner_->patience(); }

 private:
  std::unique_ptr<View> inner_;
  Geometry frame_;
  float share_;
  bool mirrored_;
  double shift_px_;
  std::vector<float> ghost_;
};

auto add_ghost(const EffectSetup& setup) {
  return [share = setup.number("share"), mirrored = setup.form("mirrored"), shift_px = setup.number("shift_px")](
             std::unique_ptr<View> inner, const CameraModel& model) {
    return std::make_unique<GhostView>(std::move(inner), model.geometry, share, mirrored, shift_px);
  };
}

}  // namespace

std::vector<EffectType> optics_effects() {
  return {
      EffectType("emissivity", Stage::kRadiometry, Order::kEmission,
                 "the radiance is e B(T) + (1 - e) B(T_surroundings), read out as if it were a black body's",
                 {{"emissivity", "", 0.96, {0.05, 1.0}, {{0.93, 0.985}}, "e"},
                  {"surroundings_k", "K", 295.0, {150.0, 600.0}, {}, "temperature of what is reflected"}},
                 {}, hooked(grey_body)),
      EffectType("radiometric_nonlinearity", Stage::kRadiometry, Order::kRadiance,
                 "optics and pixels are linear in the radiance from 7.5 to 14 um (Planck); the read-out shows "
                 "temperature",
                 {}, {}, maker<RadiometricNonlinearity>()),
      EffectType("optical_psf", Stage::kOptics, Order::kOptics,
                 "the optics blur: a Gaussian, or a disc of radius 2 sigma, which has the same variance",
                 {{"sigma_px", "px", 0.7, {0.05, 5.0}, {{0.4, 1.1}}, "standard deviation along x and along y"}},
                 {"gaussian", "disc"}, maker<OpticalPsf>()),
      EffectType(
          "vignetting", Stage::kOptics, Order::kOptics,
          "the gain falls with the square of the distance from the middle",
          {{"corner_loss", "", 0.01, {0.0, 0.9}, {{0.005, 0.02}}, "of the gain in the corners"},
           {"reference_k", "K", 295.0, {200.0, 400.0}, {}, "the camera's own temperature, which shows in its place"}},
          {}, hooked(darken_corners)),
      outside_catalogue(
          EffectType("lens_ghost", Stage::kOptics, Order::kOptics,
                     "a faint copy of the picture lies on it, turned by half a turn or shifted along x",
                     {{"share", "", 0.02, {0.0, 0.9}, {{0.01, 0.04}}, "of the signal that belongs to the copy"},
                      {"shift_px", "px", 7.0, {-1000.0, 1000.0}, {}, "of the shifted copy"}},
                     {"mirrored", "shifted"}, hooked(add_ghost))),
  };
}

}  // namespace bolo::sim
