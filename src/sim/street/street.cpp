// Layout of the street: slots for each kind of object. The content of a slot depends only on the seed and the slot's
// number, so the street is endless and any part of it can be drawn separately.
#include <cmath>

#include "src/sim/field.hpp"
#include "src/sim/street/painter.hpp"

namespace bolo::sim {
namespace street {
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

void paint_sky(Painter& painter) {
  Box above = painter.box();
  above.bottom = std::min(above.bottom, kPavementTop);
  painter.rectangle(above, sky);
  // Distant trees against the sky, visible between houses.
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
  // The paint of the lane markings reflects the sky.
  const auto dash = [](double x, double) { return std::fmod(std::fmod(x, 64.0) + 64.0, 64.0) < 30.0; };
  painter.fill({left, 110.0, right, 112.2}, dash, Surface{287.2, 0.4, 1.2});
}

enum class Thing : std::uint64_t { kHouse, kTree, kLamp, kSign, kPerson, kCar };

class Street final : public Scene {
 public:
  Street(Geometry view, std::uint64_t seed) : view_(view), seed_(key(0, seed)) {}

  Geometry size() const override { return view_; }

  capture::StillImage draw(Region region) const override {
    constexpr int kTile = 256;  // columns; limits the memory of the fine raster
    capture::StillImage image{region.width, region.height, {}};
    image.kelvin.resize(Geometry{region.width, region.height}.pixels());
    for (int x = 0; x < region.width; x += kTile) {
      Painter painter({region.x + x, region.y, std::min(kTile, region.width - x), region.height}, view_.height / 120.0);
      paint(painter);
      painter.average(image.kelvin.data() + x, static_cast<std::size_t>(region.width));
    }
    return image;
  }

 private:
  // Calls paint_one(x, random) for each slot that may be visible; x is a random place in the slot.
  template <typename PaintOne>
  void each(const Painter& painter, Thing kind, double pitch, double probability, PaintOne paint_one) const {
    const std::uint64_t kind_key = key(seed_, static_cast<std::uint64_t>(kind));
    const double last = std::floor((painter.box().right + kReach) / pitch);
    for (double slot = std::floor((painter.box().left - kReach) / pitch); slot <= last; slot += 1.0) {
      SplitMix random(key(kind_key, static_cast<std::uint64_t>(static_cast<std::int64_t>(slot))));
      const double x = pitch * (slot + random.between(0.15, 0.85));
      if (random.chance(probability)) paint_one(x, random);
    }
  }

  // The border between house `slot - 1` and house `slot`.
  double border(double slot) const {
    const std::uint64_t borders = key(seed_, 100);
    SplitMix random(key(borders, static_cast<std::uint64_t>(static_cast<std::int64_t>(slot))));
    return kHousePitch * slot + random.between(-22.0, 22.0);
  }

  void paint(Painter& painter) const {
    paint_sky(painter);
    each(painter, Thing::kHouse, kHousePitch, 0.82, [&](double x, SplitMix random) {
      const double slot = std::floor(x / kHousePitch);
      const double gap = random.chance(0.5) ? random.between(2.0, 14.0) : 0.0;
      paint_house(painter, border(slot) + gap, border(slot + 1.0), random);
    });
    paint_ground(painter);
    const auto stand = [&painter](auto paint_one, double y) {
      return [&painter, paint_one, y](double x, SplitMix random) {
        paint_one(painter, Point{x, y + random.between(-1.5, 1.5)}, random);
      };
    };
    each(painter, Thing::kTree, 190.0, 0.6, stand(paint_tree, 88.0));
    each(painter, Thing::kPerson, 58.0, 0.62, stand(paint_person, 89.5));
    each(painter, Thing::kLamp, 210.0, 0.9, stand(paint_lamp, 91.5));
    each(painter, Thing::kSign, 160.0, 0.6, stand(paint_sign, 91.5));
    each(painter, Thing::kCar, 168.0, 0.75, stand(paint_car, 107.5));
  }

  static constexpr double kHousePitch = 140.0;
  Geometry view_;
  std::uint64_t seed_;
};

}  // namespace
}  // namespace street

std::unique_ptr<const Scene> make_street(Geometry view, std::uint64_t seed) {
  return std::make_unique<street::Street>(view, seed);
}

}  // namespace bolo::sim
