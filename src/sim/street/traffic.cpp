// Cars and people.
#include <array>
#include <cmath>

#include "src/sim/street/painter.hpp"

namespace bolo::sim::street {
namespace {

// The car faces +forward; up is above the road.
struct Frame {
  Point ground;
  double facing;

  Point at(double forward, double up) const { return {ground.x + facing * forward, ground.y - up}; }

  template <std::size_t N>
  std::array<Point, N> outline(const std::array<Point, N>& forward_up) const {
    std::array<Point, N> points{};
    for (std::size_t i = 0; i < N; ++i) points[i] = at(forward_up[i].x, forward_up[i].y);
    return points;
  }
};

constexpr std::array<Point, 16> kBody{{{-48, 7},
                                       {-49, 12},
                                       {-48, 19},
                                       {-45, 21.5},
                                       {-35, 22.5},
                                       {-26, 31},
                                       {-19, 33},
                                       {6, 33},
                                       {13, 31.5},
                                       {24, 22.5},
                                       {40, 20.5},
                                       {46, 18},
                                       {48.5, 13},
                                       {48.5, 8},
                                       {46, 6},
                                       {-46, 6}}};
constexpr std::array<Point, 5> kRearPane{{{-31, 22.8}, {-24.5, 29.6}, {-18.5, 31.2}, {-7, 31.2}, {-7, 22.8}}};
constexpr std::array<Point, 5> kFrontPane{{{-5, 22.8}, {-5, 31.2}, {6, 31.2}, {11.5, 29.8}, {17, 22.8}}};
constexpr std::array<Point, 4> kWindscreen{{{13.2, 31}, {14.8, 30}, {23, 22.9}, {20, 22.9}}};
constexpr std::array<Point, 6> kBonnet{{{24, 22.5}, {40, 20.5}, {46, 18}, {48, 15}, {30, 15}, {22, 20}}};

void paint_wheel(Painter& painter, Point axle, double brake_k, double spokes_angle) {
  painter.ellipse(axle, 8.6, 8.6, Surface{286.0});  // the arch
  painter.ellipse(axle, 7.4, 7.4, Surface{301.5, 0.8, 1.5});
  const auto rim = [=](double x, double y) {
    const double spoke = std::cos(5.0 * (std::atan2(y - axle.y, x - axle.x) + spokes_angle));
    return spoke > 0.1 ? 292.5 : brake_k;
  };
  painter.ellipse(axle, 4.9, 4.9, rim);
  painter.ellipse(axle, 1.4, 1.4, Surface{304.0});
}

void paint_glass(Painter& painter, const Frame& car) {
  const Surface glass{282.4, 0.2, 6.0, car.ground.y - 31.0, 0.18};
  painter.polygon(car.outline(kRearPane), glass);
  painter.polygon(car.outline(kFrontPane), glass);
  painter.polygon(car.outline(kWindscreen), Surface{281.2});
}

void paint_heat(Painter& painter, const Frame& car) {
  // The engine warms the bonnet from its middle.
  const Point engine = car.at(35.0, 18.0);
  const auto bonnet = [engine](double x, double y) {
    const double u = (x - engine.x) / 12.0;
    const double v = (y - engine.y) / 5.0;
    return 291.5 + 7.0 * std::exp(-u * u - v * v);
  };
  painter.polygon(car.outline(kBonnet), bonnet);
  const Point grill = car.at(47.3, 12.5);
  painter.ellipse(grill, 1.3, 2.8, Surface{303.0});
  painter.ellipse(car.at(-47.5, 6.4), 1.8, 1.4, Surface{310.8});  // exhaust
}

struct Clothes {
  double coat_k;
  double legs_k;
  double stripes_k;

  // Folds and knitting: fine lines across the body.
  auto coat() const {
    return [*this](double x, double y) {
      return coat_k + stripes_k * texture(0.35 * x, y, 1.2, 51) + 0.9 * texture(x, y, 3.5, 52);
    };
  }
  Surface legs() const { return {legs_k, 0.7, 2.0}; }
};

constexpr Surface kSkin{306.3, 0.5, 1.5};

// `facing`: 1 to the right, -1 to the left; `stride`: half the distance between the feet.
struct Pose {
  Point foot;
  double size;  // height of the person / 46
  double facing;
  double stride;

  Point at(double forward, double up) const { return {foot.x + facing * forward * size, foot.y - up * size}; }
};

void paint_leg(Painter& painter, const Pose& pose, double forward, const Clothes& clothes) {
  const double s = pose.size;
  const Point hip = pose.at(0.0, 22.0);
  const Point knee = pose.at(0.55 * forward + 0.9, 11.5);
  const Point ankle = pose.at(forward, 1.6);
  painter.limb(hip, 2.9 * s, knee, 2.1 * s, clothes.legs());
  painter.limb(knee, 2.1 * s, ankle, 1.4 * s, clothes.legs());
  painter.limb(ankle, 1.3 * s, pose.at(forward + 2.6, 0.9), 1.0 * s, Surface{292.6});
}

void paint_arm(Painter& painter, const Pose& pose, double forward, const Clothes& clothes) {
  const double s = pose.size;
  const Point shoulder = pose.at(0.0, 36.0);
  const Point elbow = pose.at(0.6 * forward - 0.6, 29.0);
  const Point wrist = pose.at(forward + 0.8, 23.2);
  painter.limb(shoulder, 1.8 * s, elbow, 1.5 * s, clothes.coat());
  painter.limb(elbow, 1.5 * s, wrist, 1.2 * s, clothes.coat());
  painter.ellipse(pose.at(forward + 1.0, 21.9), 1.4 * s, 1.6 * s, Surface{304.8});
}

void paint_head(Painter& painter, const Pose& pose, bool hat) {
  const double s = pose.size;
  painter.limb(pose.at(0.1, 38.2), 1.6 * s, pose.at(0.2, 40.0), 1.6 * s, Surface{307.8});  // the neck is warmest
  painter.ellipse(pose.at(0.4, 42.6), 2.7 * s, 3.4 * s, kSkin);
  painter.ellipse(pose.at(3.0, 42.2), 0.6 * s, 0.7 * s, Surface{301.5});  // the nose is cool
  const Point crown = pose.at(-0.2, 44.2);
  painter.ellipse(crown, 2.8 * s, (hat ? 2.3 : 1.9) * s, Surface{hat ? 295.5 : 300.2, 0.6, 1.0});
}

}  // namespace

void paint_car(Painter& painter, Point ground, SplitMix random) {
  const Frame car{ground, random.chance(0.5) ? 1.0 : -1.0};
  const double body_k = random.between(285.6, 289.4);
  const bool running = random.chance(0.75);
  const double brake_k = running ? random.between(305.0, 310.0) : 297.0;
  // The road below is warmed, and shielded from the cold sky.
  painter.ellipse(car.at(0.0, 0.6), 50.0, 3.4, Surface{running ? 296.5 : 292.8, 0.5, 1.3});
  if (running) painter.ellipse(car.at(30.0, 0.8), 14.0, 2.4, Surface{299.0, 0.4});

  // Upper surfaces reflect the sky, lower ones the road.
  const Surface paint{body_k, 0.25, 5.0, ground.y - 20.0, 0.16};
  painter.polygon(car.outline(kBody), paint);
  painter.limb(car.at(-19.0, 32.4), 0.7, car.at(8.0, 32.4), 0.7, Surface{281.8});  // roof
  if (running) paint_heat(painter, car);
  paint_glass(painter, car);
  for (const double seam : {-6.0, 18.5})
    painter.limb(car.at(seam, 22.5), 0.35, car.at(seam - 1.0, 8.5), 0.35, Surface{body_k + 3.0});
  painter.limb(car.at(-46.0, 17.4), 0.4, car.at(28.0, 17.4), 0.4, Surface{body_k - 2.2});
  for (const double handle : {-11.0, 12.0})
    painter.limb(car.at(handle - 2.0, 20.0), 0.5, car.at(handle + 2.0, 20.0), 0.5, Surface{body_k - 3.0});
  painter.ellipse(car.at(19.0, 23.6), 2.2, 1.6, Surface{285.0});  // mirror
  painter.ellipse(car.at(45.0, 17.0), 2.4, 1.3, Surface{running ? 296.0 : 285.5});
  painter.ellipse(car.at(-46.8, 18.0), 1.3, 1.8, Surface{running ? 293.5 : 285.5});
  for (const double axle : {-30.0, 31.0}) paint_wheel(painter, car.at(axle, 7.4), brake_k, random.between(0.0, 1.2));
}

void paint_person(Painter& painter, Point foot, SplitMix random) {
  const Pose pose{foot, random.between(0.92, 1.12), random.chance(0.5) ? 1.0 : -1.0, random.between(0.8, 5.8)};
  const Clothes clothes{random.between(296.0, 301.0), random.between(295.0, 299.0), random.between(0.6, 1.8)};
  const double s = pose.size;
  const bool hat = random.chance(0.3);
  const bool bag = random.chance(0.35);
  paint_arm(painter, pose, -0.9 * pose.stride, clothes);
  paint_leg(painter, pose, -pose.stride, clothes);
  paint_leg(painter, pose, pose.stride, clothes);
  painter.limb(pose.at(0.0, 34.8), 3.9 * s, pose.at(0.0, 23.0), 3.2 * s, clothes.coat());
  if (bag) painter.limb(pose.at(-4.4, 34.0), 1.9 * s, pose.at(-4.4, 28.0), 2.1 * s, Surface{290.5, 0.4});
  paint_arm(painter, pose, 0.9 * pose.stride, clothes);
  paint_head(painter, pose, hat);
}

}  // namespace bolo::sim::street
