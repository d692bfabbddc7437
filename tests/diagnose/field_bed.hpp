// Simulated recordings without a bench: a street passed by hand or by car, with or without a moving object.
#pragma once

#include "src/sim/field.hpp"
#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::bed {

// A warm, patterned box that crosses the picture in front of a background.
class WithMover final : public sim::Field {
 public:
  WithMover(std::unique_ptr<const sim::Field> behind, Geometry view, double speed_px_s)
      : behind_(std::move(behind)), view_(view), speed_px_s_(speed_px_s) {}

  void sample_from(double t_s, double column, int row, std::span<float> out) const noexcept override {
    behind_->sample_from(t_s, column, row, out);
    const double height = 0.35 * view_.height;
    const double width = 0.2 * view_.width;
    const double top = 0.4 * view_.height + 6.0 * std::sin(5.0 * t_s);
    const double left = std::fmod(speed_px_s_ * (t_s + 10.0), view_.width + 2.0 * width) - width;
    const double in_rows = cover(row, top, top + height);
    for (std::size_t i = 0; i < out.size() && in_rows > 0.0; ++i) {
      const double x = column + static_cast<double>(i);
      const double share = in_rows * cover(x, left, left + width);
      const double value = 306.0 + 2.0 * std::sin(0.7 * (x - left)) * std::cos(0.5 * (row - top));
      out[i] += static_cast<float>(share * (value - static_cast<double>(out[i])));
    }
  }
  void instants(double from_s, double to_s, double response_s, std::vector<double>& out) const override {
    constexpr double kStep = 0.0005;
    std::vector<double> all;
    behind_->instants(from_s, to_s, response_s, all);
    for (double t = kStep * (std::floor(from_s / kStep) + 1.0); t < to_s; t += kStep) all.push_back(t);
    std::sort(all.begin(), all.end());
    for (const double t : all) {
      if (t > from_s && t <= to_s && (out.empty() || t > out.back())) out.push_back(t);
    }
  }
  sim::Extremes extremes() const override {
    const sim::Extremes e = behind_->extremes();
    return {std::min(e.low_k, 303.0), std::max(e.high_k, 309.0)};
  }
  capture::Stimulus stimulus(double, double) const override { return capture::NoStimulus{}; }

 private:
  // Share of the pixel centred at `at` that lies between `low` and `high`.
  static double cover(double at, double low, double high) {
    return std::clamp(std::min(at + 0.5, high) - std::max(at - 0.5, low), 0.0, 1.0);
  }
  std::unique_ptr<const sim::Field> behind_;
  Geometry view_;
  double speed_px_s_;
};

struct Shot {
  Geometry view{160, 120};
  int frames = 400;
  double tau_s = 0.011;
  sim::Path path = sim::steady_pan(300.0);
  double mover_px_s = 0.0;  // 0: no moving object
  std::vector<std::string> effects{};
  double period_s = testing::kPeriodS;
  bool sky = false;         // sky above some roofs instead of the street
  std::vector<int> lost{};  // lost frames, without a gap in the counter
};

// A path that starts, stops and turns, up to 750 px/s; at rest until `from_s`.
inline sim::Path restless(double from_s = -10.0) {
  std::vector<sim::PathPoint> points;
  for (double t = -0.6; t < 5.0; t += 0.001) {
    const double moves = 1.0 / (1.0 + std::exp((from_s - t) / 0.02));
    const double along = 27.0 * std::sin(11.0 * t) + 17.0 * std::sin(23.0 * t + 1.0);
    points.push_back({t, moves * along, moves * 7.0 * std::sin(17.0 * t)});
  }
  return sim::Path(std::move(points));
}

// Up to 7000 px/s.
inline sim::Path fast_hand() {
  std::vector<sim::PathPoint> points;
  for (double t = -0.6; t < 6.0; t += 0.001) {
    points.push_back(
        {t, 300.0 * std::sin(12.0 * t + 1.5) + 150.0 * std::sin(25.2 * t + 1.0), 75.0 * std::sin(19.2 * t + 1.5)});
  }
  return sim::Path(std::move(points));
}

// Up to 300 px/s.
inline sim::Path slow_hand() {
  std::vector<sim::PathPoint> points;
  for (double t = -0.6; t < 8.0; t += 0.002)
    points.push_back({t, 60.0 * std::sin(4.0 * t) + 20.0 * std::sin(9.0 * t), 25.0 * std::sin(6.3 * t)});
  return sim::Path(std::move(points));
}

// A hand at rest except for some moves of about four times `rise_s` each.
inline sim::Path jerks(double rise_s = 0.008) {
  std::vector<sim::PathPoint> points;
  const auto moved = [rise_s](double t, double at_s) { return 1.0 / (1.0 + std::exp((at_s - t) / rise_s)); };
  for (double t = -0.6; t < 5.0; t += 0.001) {
    const double along = 55.0 * moved(t, 0.3) - 80.0 * moved(t, 0.62);
    points.push_back({t, 3.0 * std::sin(3.0 * t) + along, 3.0 * std::sin(5.0 * t) + 0.8 * along});
  }
  return sim::Path(std::move(points));
}

// A jerk every 0.7 s, each in another direction.
inline sim::Path many_jerks(double seconds) {
  std::vector<sim::PathPoint> points;
  for (double t = -0.6; t < seconds; t += 0.002) {
    sim::PathPoint at{t, 3.0 * std::sin(3.0 * t), 3.0 * std::sin(5.0 * t)};
    for (int k = 0; 0.4 + 0.7 * k < seconds; ++k) {
      const double moved = 1.0 / (1.0 + std::exp((0.4 + 0.7 * k - t) / 0.008));
      at.x_px += moved * 30.0 * std::cos(2.78 * k);
      at.y_px += moved * 22.5 * std::sin(2.78 * k);
    }
    points.push_back(at);
  }
  return sim::Path(std::move(points));
}

// Colder with height, some clouds, above roofs with windows.
inline std::unique_ptr<const sim::Scene> make_sky() {
  capture::StillImage image{640, 480, {}};
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const int house = x / 50;
      const int roof = 225 + 13 * house * house % 40;
      const double window = (x / 7 + y / 9) % 3 == 0 ? 6.0 : 0.0;
      const double air = 250.0 + 0.05 * y + 0.4 * std::sin(0.02 * x) * std::cos(0.03 * y + 0.011 * x);
      image.kelvin.push_back(static_cast<float>(y < roof ? air : 275.0 + house % 5 + window));
    }
  }
  return sim::make_still_scene(std::move(image));
}

inline constexpr std::uint64_t kSeed = 3;

inline sim::CameraSettings camera_of(const Shot& shot) {
  sim::CameraSettings camera;
  camera.geometry = shot.view;
  camera.rate_hz = 1.0 / shot.period_s;
  camera.tau_s = shot.tau_s;
  camera.readout.seed = kSeed;
  camera.camera_seed = kSeed + 77;
  for (const std::string& text : shot.effects) camera.effects.push_back(sim::parse_effect(text).value());
  return camera;
}

// Records a street or a sky, without a stimulus.
inline std::filesystem::path shoot(const Shot& shot, const std::filesystem::path& file) {
  const auto scene = shot.sky ? make_sky() : sim::make_street(shot.view, kSeed);
  const double end_s = shot.frames * shot.period_s + 0.1;
  const auto origin = sim::centred_origin(*scene, shot.path, shot.view, -0.5, end_s);
  std::unique_ptr<const sim::Field> seen = sim::pan_over(*scene, shot.path, origin, shot.view, -0.5, end_s).value();
  if (shot.mover_px_s != 0.0) seen = std::make_unique<WithMover>(std::move(seen), shot.view, shot.mover_px_s);
  const auto simulator = sim::Simulator::create(camera_of(shot), std::move(seen)).value();
  int taken = 0;
  const auto next = [&](int, std::vector<std::uint16_t>& plane) {
    do simulator->next(plane.data(), nullptr);
    while (std::ranges::count(shot.lost, taken++) != 0);
  };
  return testing::write_capture<std::uint16_t>(file, shot.view, shot.frames - static_cast<int>(shot.lost.size()), next,
                                               capture::NoStimulus{}, shot.period_s);
}

}  // namespace bolo::diagnose::bed
