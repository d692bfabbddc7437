#include <cmath>

#include "src/sim/street/objects.hpp"

namespace bolo::sim::street {
namespace {

double sky(double x, double y) noexcept {
  const double height = std::clamp(y / 60.0, -0.3, 1.0);
  return 279.5 + 4.0 * height + 0.7 * texture(x, 2.5 * y, 45.0, 11) + 0.3 * texture(x, 2.5 * y, 14.0, 12);
}

double road(double x, double y) noexcept {
  const auto track = [y](double middle) { return std::max(0.0, 1.0 - 0.04 * (y - middle) * (y - middle)); };
  return 290.0 + 0.03 * (y - kRoadTop) + 1.0 * (track(103.0) + track(117.0)) + 0.55 * texture(x, y, 1.1, 21) +
         0.6 * texture(x, 2.0 * y, 30.0, 22);
}

double pavement(double x, double y) noexcept {
  const bool joint = std::fmod(std::fmod(x, 11.0) + 11.0, 11.0) < 0.7;
  return 291.6 + 0.3 * texture(x, y, 1.3, 23) - (joint ? 1.2 : 0.0);
}

}  // namespace

void paint_sky(Painter& painter) {
  Box above = painter.box();
  above.bottom = std::min(above.bottom, kPavementTop);
  painter.rectangle(above, sky);
  // Far trees against the sky, seen where no house stands.
  const auto under_crowns = [](double x, double y) { return y > 62.0 + 9.0 * texture(x, 0.0, 17.0, 31); };
  const Box far{painter.box().left, 45.0, painter.box().right, kPavementTop};
  painter.fill(far, under_crowns, Surface{285.2, 0.8, 2.2, 60.0, 0.06});
}

void paint_ground(Painter& painter) {
  const double left = painter.box().left;
  const double right = painter.box().right;
  painter.rectangle({left, kPavementTop, right, kKerb}, pavement);
  painter.rectangle({left, kKerb, right, kRoadTop}, Surface{294.2, 0.3});
  painter.rectangle({left, kRoadTop, right, std::max(painter.box().bottom, kRoadTop)}, road);
  // The paint of the lane's dashes reflects the sky.
  const auto dash = [](double x, double) { return std::fmod(std::fmod(x, 64.0) + 64.0, 64.0) < 30.0; };
  painter.fill({left, 110.0, right, 112.2}, dash, Surface{287.2, 0.4, 1.2});
}

}  // namespace bolo::sim::street
