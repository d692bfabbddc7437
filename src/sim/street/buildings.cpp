// Houses, trees, lamps, signs.
#include <cmath>

#include "src/sim/street/painter.hpp"

namespace bolo::sim::street {
namespace {

// Mortar between rows of bricks; every second row is shifted by half a brick.
double bricks(double x, double y) noexcept {
  const double row = std::floor(y / 3.0);
  const double shifted = x + (static_cast<std::int64_t>(row) % 2 == 0 ? 0.0 : 3.0);
  const bool mortar = y - 3.0 * row < 0.6 || shifted - 6.0 * std::floor(shifted / 6.0) < 0.6;
  return mortar ? 0.9 : 0.0;
}

void paint_window(Painter& painter, const Box& glass, SplitMix& random) {
  const bool heated = random.chance(0.25);
  const Surface frame{heated ? 295.5 : 290.8};
  const Surface pane{heated ? random.between(291.0, 294.5) : random.between(282.0, 284.5), 0.25, 4.0};
  const double middle = (glass.left + glass.right) / 2.0;
  const double bar = glass.top + (glass.bottom - glass.top) * 0.35;
  painter.rectangle({glass.left - 1.0, glass.top - 1.0, glass.right + 1.0, glass.bottom + 1.0}, frame);
  painter.rectangle(glass, pane);
  painter.rectangle({middle - 0.4, glass.top, middle + 0.4, glass.bottom}, frame);
  painter.rectangle({glass.left, bar - 0.4, glass.right, bar + 0.4}, frame);
  // The radiator niche below the sill warms the wall.
  if (heated)
    painter.rectangle({glass.left - 1.5, glass.bottom + 1.0, glass.right + 1.5, glass.bottom + 3.2}, Surface{297.0});
}

void paint_shop(Painter& painter, double left, double right, SplitMix& random) {
  painter.rectangle({left + 5.0, 62.0, right - 5.0, 65.0}, Surface{294.0, 0.3});  // the sign's lit box
  for (double x = left + 7.0; x + 20.0 < right - 5.0; x += 24.0) {
    painter.rectangle({x - 0.8, 66.2, x + 20.8, kPavementTop}, Surface{288.0});
    painter.rectangle({x, 67.0, x + 20.0, 82.0}, Surface{random.between(284.0, 288.5), 0.5, 5.0, 67.0, 0.12});
  }
}

void paint_door(Painter& painter, double x, SplitMix& random) {
  painter.rectangle({x - 1.2, 63.8, x + 12.2, kPavementTop}, Surface{288.3});
  painter.rectangle({x, 65.0, x + 11.0, kPavementTop}, Surface{random.between(291.5, 295.0), 0.3, 3.0});
  painter.rectangle({x + 2.0, 67.0, x + 9.0, 72.0}, Surface{285.0});
  painter.ellipse({x + 9.3, 75.5}, 0.7, 0.7, Surface{284.0});
}

}  // namespace

void paint_house(Painter& painter, double left, double right, SplitMix random) {
  const double roof = random.between(3.0, 26.0);
  const double wall = random.between(287.2, 291.4);
  const bool brick = random.chance(0.6);
  const auto face = [=](double x, double y) {
    return wall + 0.03 * (y - roof) + 0.45 * texture(x, y, 2.0, 41) + 0.5 * texture(x, y, 25.0, 42) -
           (brick ? bricks(x, y) : 0.0);
  };
  const double chimney = random.between(left + 12.0, right - 24.0);
  painter.rectangle({chimney, roof - 9.0, chimney + 9.0, roof}, Surface{287.5, 0.4});
  painter.rectangle({chimney + 1.5, roof - 11.0, chimney + 7.5, roof - 9.0},
                    Surface{random.chance(0.6) ? 302.0 : 286.0});
  painter.rectangle({left, roof, right, kPavementTop}, face);
  painter.rectangle({left - 1.5, roof - 1.0, right + 1.5, roof + 2.2}, Surface{283.5, 0.3});
  painter.rectangle({left - 1.5, roof + 2.2, right + 1.5, roof + 3.2}, Surface{wall + 2.0});

  const double pitch = random.between(19.0, 25.0);
  const int columns = std::max(1, static_cast<int>((right - left - 8.0) / pitch));
  const double first = (left + right - pitch * columns) / 2.0 + pitch / 2.0;
  for (double top = roof + 8.0; top + 14.0 < 60.0; top += 22.0) {
    for (int i = 0; i < columns; ++i) {
      const double x = first + pitch * i;
      paint_window(painter, {x - 5.0, top, x + 5.0, top + 13.0}, random);
    }
  }
  if (random.chance(0.45)) {
    paint_shop(painter, left, right, random);
  } else {
    const int entrance = static_cast<int>(random.between(0.0, columns));
    for (int i = 0; i < columns; ++i) {
      const double x = first + pitch * i;
      if (i == entrance) {
        paint_door(painter, x - 5.5, random);
      } else {
        paint_window(painter, {x - 5.0, 65.0, x + 5.0, 77.0}, random);
      }
    }
  }
  painter.rectangle({right - 3.5, roof + 3.0, right - 2.0, kPavementTop}, Surface{285.0});  // the rain pipe
}

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
    // Leaves: gaps show the background.
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
