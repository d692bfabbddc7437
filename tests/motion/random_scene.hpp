// Random scenes: moving objects, camera motion, background and noise.
#pragma once

#include "tests/motion/scenes.hpp"

namespace bolo::motion::testing {

// Motion as of a vehicle, a hand or a turned head. Sudden changes are near time `event`, frames.
class RandomScene {
 public:
  RandomScene(std::uint32_t seed, double event) : random_(seed), event_(event) {
    const Scene back = moved(texture(), motion());
    scene_ = back;
    switch (static_cast<int>(unit() * 6.0)) {
      case 0: {  // a moving object
        const auto path = motion();
        const auto front = texture();
        const double x = 100.0 * unit();
        const double y = 70.0 * unit();
        const double half = 8.0 + 24.0 * unit();
        scene_ = [=](double px, double py, double t) {
          const Place p = path(t);
          const bool in = std::abs(px - x - p.x) < half && std::abs(py - y - p.y) < half;
          return in ? 2.0 + front(px - p.x, py - p.y) : back(px, py, t);
        };
        break;
      }
      case 1: {  // two depths
        const double edge = 20.0 + 50.0 * unit();
        scene_ = [edge, back, near = moved(texture(), motion())](double x, double y, double t) {
          return y < edge ? back(x, y, t) : near(x, y, t);
        };
        break;
      }
      case 2:  // a cut
        scene_ = [at = event_ - unit(), back, after = moved(texture(), motion())](double x, double y, double t) {
          return t < at ? back(x, y, t) : after(x, y, t);
        };
        break;
      default:
        break;
    }
    noise_ = log_between(0.03, 1.0);
    lost_ = unit() < 0.3 ? 0.2 * unit() : 0.0;
    pattern_ = unit() < 0.2 ? 0.2 * unit() : 0.0;
  }
  const Scene& scene() const { return scene_; }
  double noise() const { return noise_; }
  double lost() const { return lost_; }        // share of the frames
  double pattern() const { return pattern_; }  // K, of a fixed pattern

 private:
  struct Place {
    double x = 0.0;
    double y = 0.0;
  };
  using Motion = std::function<Place(double t)>;
  using Still = std::function<double(double x, double y)>;

  double unit() { return std::uniform_real_distribution<double>(0.0, 1.0)(random_); }
  double log_between(double low, double high) { return low * std::pow(high / low, unit()); }

  Motion motion() {
    const double speed = unit() < 0.2 ? 0.0 : log_between(0.05, 14.0);
    const double angle = 6.283185 * unit();
    const Place v{speed * std::cos(angle), speed * std::sin(angle)};
    const double period = 15.0 + 60.0 * unit();
    const double phase = 6.283185 * unit();
    const double stop = event_ - unit();
    switch (static_cast<int>(unit() * 5.0)) {
      case 0:  // a hand
        return [=](double t) {
          const double s = period / 6.283185 * std::sin(t / period * 6.283185 + phase);
          return Place{v.x * s + 0.2 * v.y * s, v.y * s - 0.3 * v.x * t};
        };
      case 1:  // slows down
        return [=](double t) {
          const double s = t < stop ? t : stop + 5.0 * (1.0 - std::exp((stop - t) / 5.0));
          return Place{v.x * s, v.y * s};
        };
      default:
        return [=](double t) { return Place{v.x * t, v.y * t}; };
    }
  }
  Still texture() {
    const double contrast = log_between(0.3, 10.0);
    const double a = 6.283185 * unit();
    const double c = std::cos(a);
    const double s = std::sin(a);
    const double period = 12.0 + 30.0 * unit();
    const Texture fine(static_cast<std::uint32_t>(random_()), contrast);
    switch (static_cast<int>(unit() * 6.0)) {
      case 0:  // edges of one direction
        return [=](double x, double y) { return contrast * std::tanh(3.0 * std::sin((c * x + s * y) / period)); };
      case 1:  // squares
        return [=](double x, double y) {
          const double u = std::sin((c * x + s * y) / period * 3.0) * std::sin((c * y - s * x) / period * 3.0);
          return contrast * std::tanh(8.0 * u) + 0.2 * fine(x, y);
        };
      case 2:
        return [=](double x, double y) { return 0.02 * fine(x, y); };  // nearly flat
      default:
        return fine;
    }
  }
  static Scene moved(const Still& still, const Motion& motion) {
    return [still, motion](double x, double y, double t) {
      const Place p = motion(t);
      return still(x - p.x, y - p.y);
    };
  }

  std::mt19937 random_;
  double event_;
  Scene scene_;
  double noise_ = 0.0;
  double lost_ = 0.0;
  double pattern_ = 0.0;
};

}  // namespace bolo::motion::testing
