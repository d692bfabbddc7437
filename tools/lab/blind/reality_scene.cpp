// The bench of the second reality, and its optics.
#include "tools/lab/blind/reality.hpp"

namespace bolo::tools::blind::second {
namespace {

constexpr double kHousingK = 301.0;

// Trapezoid rule, in arbitrary units.
double radiance_sum(double kelvin) {
  double total = 0.0;
  constexpr int kParts = 40;
  for (int i = 0; i <= kParts; ++i) {
    const double um = 8.0 + 4.0 * i / kParts;
    total += (i == 0 || i == kParts ? 0.5 : 1.0) / (std::pow(um, 5) * std::expm1(14387.77 / (um * kelvin)));
  }
  return total;
}

// Loss of light towards the corners: cos^4 about any centre, scaled by the farthest corner.
Plane corner_loss(const Hidden& hidden, Geometry g) {
  Plane loss(g.pixels(), 0.0);
  if (!hidden.has("vignetting")) return loss;
  const double cx = g.width * (0.5 + hidden.number("vignetting", "centre_x", 0.0));
  const double cy = g.height * (0.5 + hidden.number("vignetting", "centre_y", 0.0));
  double most = 0.0;
  for (std::size_t p = 0; p < loss.size(); ++p) {
    const auto x = static_cast<double>(p % static_cast<std::size_t>(g.width)) + 0.5 - cx;
    const std::size_t row = p / static_cast<std::size_t>(g.width);
    const double y = static_cast<double>(row) + 0.5 - cy;
    const double tan2 = 0.05 * (x * x + y * y) / (g.width * g.width / 4.0);
    loss[p] = 1.0 - 1.0 / ((1.0 + tan2) * (1.0 + tan2));
    most = std::max(most, loss[p]);
  }
  for (double& one : loss) one *= hidden.number("vignetting", "corner_loss", 0.0) / most;
  return loss;
}

struct Bench {
  const CapturePlan& plan;
  const Hidden& hidden;
  Geometry g;
  Plane loss = corner_loss(hidden, g);
  std::vector<double> covered{};

  // Mean over [t, t + kSubstepS).
  void draw(double t_s, Plane& out) const {
    std::visit([&](const auto& stimulus) { paint(stimulus, t_s, out); }, plan.stimulus);
    if (const double share = hidden.number("lens_ghost", "share", 0.0); share > 0.0) {
      const Plane seen = out;
      for (std::size_t p = 0; p < out.size(); ++p) out[p] += share * (seen[seen.size() - 1 - p] - seen[p]);
    }
    const double housing = signal(kHousingK, false);
    for (std::size_t p = 0; p < out.size(); ++p) out[p] += loss[p] * (housing - out[p]);
  }

  double bench(std::string_view key) const {
    const auto at = plan.bench.find(key);
    return at == plan.bench.end() ? 0.0 : at->second;
  }

  // Input of a pixel: apparent temperature, or radiance.
  double signal(double kelvin, bool target) const {
    if (target && hidden.has("emissivity")) {
      const double e = hidden.number("emissivity", "emissivity", 1.0);
      const double around = radiance_of(hidden.number("emissivity", "surroundings_k", 293.15));
      kelvin = temperature_of(e * radiance_of(kelvin) + (1.0 - e) * around);
    }
    return hidden.has("radiometric_nonlinearity") ? radiance_of(kelvin) : kelvin;
  }

  void paint(const capture::Uniform& u, double, Plane& out) const {
    std::ranges::fill(out, signal(u.temperature_k + bench("level_0"), true));
  }

  void paint(const capture::Chopper& c, double t_s, Plane& out) const {
    const double cold = signal(c.cold_k + bench("level_0"), true);
    std::vector<double> height;
    for (const double level : c.level_k) {
      const double off = bench(level == c.level_k.front() ? "level_1" : "level_2");
      height.push_back(signal(level + off, true) - cold);
    }
    for (int x = 0; x < g.width; ++x) {
      const double t = t_s - bench("start_s") - bench("sweep_s") * (static_cast<double>(x) / (g.width - 1) - 0.5);
      double value = cold;
      for (std::size_t i = 0; i < c.on_s.size(); ++i) {
        const double open = std::min(t + kSubstepS, c.off_s[i]) - std::max(t, c.on_s[i]);
        if (open > 0.0) value += height[i] * open / kSubstepS;
      }
      for (int y = 0; y < g.height; ++y) out[static_cast<std::size_t>(y * g.width + x)] = value;
    }
  }

  void paint(const capture::BarTarget& b, double t_s, Plane& out) const {
    const double cold = signal(b.cold_k + bench("level_0"), true);
    const double height = signal(b.hot_k + bench("level_1"), true) - cold;
    const double t = t_s + kSubstepS / 2.0;
    const double travelled = b.velocity_px_s * (1.0 + bench("velocity")) * t;
    const double wobble = b.velocity_px_s == 0.0 ? 0.0 : bench("wobble_px") * std::sin(kTwoPi * 0.6 * t);
    for (int y = 0; y < g.height; ++y) {
      const double at_row = bench("phase_px") + travelled + wobble + b.slant_px_per_row * y;
      for (int x = 0; x < g.width; ++x) {
        const double u = (x - at_row) / b.period_px;
        const double place = (u - std::floor(u)) * kTable;
        const auto i = static_cast<std::size_t>(place);
        const double share = covered[i] + (place - static_cast<double>(i)) * (covered[i + 1] - covered[i]);
        out[static_cast<std::size_t>(y * g.width + x)] = cold + height * share;
      }
    }
  }
  template <typename Other>
  void paint(const Other&, double, Plane&) const {}

  // Covered share of a pixel whose left edge is at u periods: exact along x, then blurred numerically.
  void tabulate(const capture::BarTarget& b) {
    const auto hot_up_to = [&](double x) {  // hot length in [0, x)
      const double whole = std::floor(x / b.period_px);
      return whole * b.bar_width_px + std::min(x - whole * b.period_px, b.bar_width_px);
    };
    const double sigma = hidden.number("optical_psf", "sigma_px", 0.0);
    const bool disc = hidden.has("optical_psf", "disc");
    const double lean = std::sqrt(1.0 + b.slant_px_per_row * b.slant_px_per_row);
    constexpr int kPoints = 41;  // samples of the blur
    std::vector<double> shifts;
    for (int i = 0; i < kPoints; ++i) {
      const double s = (i + 0.5) / kPoints * 2.0 - 1.0;
      shifts.push_back(disc ? 2.0 * sigma * s * lean : 3.5 * sigma * s * lean);
    }
    const auto weight = [&](double shift) {
      if (sigma <= 0.0) return 1.0;
      const double r = shift / (sigma * lean);
      return disc ? std::sqrt(std::max(0.0, 1.0 - r * r / 4.0)) : std::exp(-r * r / 2.0);
    };
    covered.assign(kTable + 2, 0.0);
    constexpr int kWithin = 8;  // samples over a row's height, and over the target's soft edge
    for (std::size_t i = 0; i < covered.size(); ++i) {
      double sum = 0.0;
      double weights = 0.0;
      for (int y = 0; y < kWithin; ++y) {
        const double within = b.slant_px_per_row * (y + 0.5) / kWithin;
        for (int e = 0; e < kWithin; ++e) {
          const double edge = bench("edge_px") * ((e + 0.5) / kWithin - 0.5);
          for (const double shift : shifts) {
            const double u = static_cast<double>(i) / kTable * b.period_px - within + edge + shift;
            sum += weight(shift) * (hot_up_to(u + 1.0) - hot_up_to(u));
            weights += weight(shift);
            if (sigma <= 0.0) break;
          }
        }
      }
      covered[i] = sum / weights;
    }
  }

  static constexpr int kTable = 2048;
};

}  // namespace

double radiance_of(double kelvin) {
  static const double at = radiance_sum(300.0);
  static const double slope = (radiance_sum(300.01) - radiance_sum(299.99)) / 0.02;
  return 300.0 + (radiance_sum(kelvin) - at) / slope;
}

double temperature_of(double radiance) {
  double kelvin = 300.0;
  for (int i = 0; i < 12; ++i) {
    const double here = radiance_of(kelvin);
    kelvin -= (here - radiance) / ((radiance_of(kelvin + 0.01) - here) / 0.01);
  }
  return kelvin;
}

Scene scene_of(const CapturePlan& plan, const Hidden& hidden, Geometry geometry) {
  auto bench = std::make_shared<Bench>(Bench{plan, hidden, geometry});
  if (const auto* bars = std::get_if<capture::BarTarget>(&plan.stimulus)) bench->tabulate(*bars);
  return [bench](double t_s, Plane& out) { bench->draw(t_s, out); };
}

}  // namespace bolo::tools::blind::second
