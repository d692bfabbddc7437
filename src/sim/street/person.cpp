#include "src/sim/street/objects.hpp"

namespace bolo::sim::street {
namespace {

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

// `facing` is 1 to the right, -1 to the left; `stride` half the distance of the feet.
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
