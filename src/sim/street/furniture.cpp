// Trees, lamps, signs.
#include <cmath>

#include "src/sim/street/objects.hpp"

namespace bolo::sim::street {

void paint_tree(Painter& painter, Point foot, SplitMix random) {
  const double height = random.between(62.0, 78.0);
  const Point fork{foot.x + random.between(-2.0, 2.0), foot.y - 0.55 * height};
  const Surface bark{288.9, 0.9, 1.3};
  painter.limb(foot, 2.9, fork, 1.9, bark);
  for (int i = 0; i < 4; ++i) {
    const double side = random.between(-17.0, 17.0);
    painter.limb(fork, 1.4, {fork.x + side, fork.y - random.between(10.0, 24.0)}, 0.6, bark);
  }
  for (int i = 0; i < 15; ++i) {
    const double angle = random.between(0.0, 6.2832);
    const double out = std::sqrt(random.between(0.0, 1.0));
    const Point c{fork.x + 17.0 * out * std::cos(angle), fork.y - 17.0 + 14.0 * out * std::sin(angle)};
    const double shade = random.between(284.3, 287.0);
    // Leaves: gaps show what is behind.
    const double r = random.between(4.5, 8.0);
    const auto leaves = [c, r](double x, double y) {
      const double u = (x - c.x) / r;
      const double v = (y - c.y) / (0.8 * r);
      return u * u + v * v + 0.45 * texture(x, y, 1.6, 61) <= 0.9;
    };
    painter.fill({c.x - 1.2 * r, c.y - 1.2 * r, c.x + 1.2 * r, c.y + 1.2 * r}, leaves, Surface{shade, 1.3, 1.4});
  }
}

void paint_lamp(Painter& painter, Point foot, SplitMix random) {
  const double arm = random.chance(0.5) ? 1.0 : -1.0;
  const Surface steel{283.2, 0.2};
  painter.rectangle({foot.x - 2.2, foot.y - 12.0, foot.x + 2.2, foot.y}, Surface{285.0, 0.2});
  painter.limb(foot, 1.5, {foot.x, foot.y - 84.0}, 1.0, steel);
  painter.limb({foot.x, foot.y - 84.0}, 0.9, {foot.x + 14.0 * arm, foot.y - 87.5}, 0.8, steel);
  painter.limb({foot.x + 13.0 * arm, foot.y - 87.0}, 1.8, {foot.x + 21.0 * arm, foot.y - 87.5}, 1.5, Surface{303.5});
}

void paint_sign(Painter& painter, Point foot, SplitMix random) {
  painter.limb(foot, 0.9, {foot.x, foot.y - 44.0}, 0.9, Surface{284.2, 0.2});
  const Point centre{foot.x, foot.y - 46.0};
  if (random.chance(0.5)) {
    painter.ellipse(centre, 5.5, 5.5, Surface{286.4});
    painter.ellipse(centre, 4.2, 4.2, Surface{281.8, 0.2});
    painter.rectangle({centre.x - 3.0, centre.y - 0.9, centre.x + 3.0, centre.y + 0.9}, Surface{286.4});
  } else {
    painter.rectangle({centre.x - 5.0, centre.y - 5.0, centre.x + 5.0, centre.y + 5.0}, Surface{286.0});
    painter.rectangle({centre.x - 4.2, centre.y - 4.2, centre.x + 4.2, centre.y + 4.2}, Surface{281.5, 0.2});
  }
}

}  // namespace bolo::sim::street
