// Dead pixels in a recording of a moving scene.
#include "src/diagnose/field_parts.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kSeenContrast = 6.0;  // minimum variation of the scene at a pixel, in sigmas, to judge its response
constexpr double kFollows = 0.4;       // slope of a pixel's value over its prediction: dead below it
constexpr double kFollow = 0.85;       // least slope of its neighbours
constexpr double kNoisyScatter = 5.0;  // times the scatter of its neighbours
constexpr double kOfEdge = 0.5;        // position error of an edge, px

// A map's or frame's values at the eight neighbours of a pixel.
template <typename Map>
std::vector<float> neighbours(const Map& map, Index p, Geometry g) {
  std::vector<float> values;
  visit_around(g, place_of(static_cast<std::size_t>(p), g.width), 1,
               [&](std::size_t other) { values.push_back(map[static_cast<Index>(other)]); });
  return values;
}

// The median of a map's known values at the eight neighbours of a pixel.
double around(const ArrayXf& map, Index p, Geometry g) {
  std::vector<float> values = neighbours(map, p, g);
  std::erase_if(values, [](float value) { return !(value > 0.0F); });
  return values.size() < 3 ? 0.0 : median(std::move(values));
}

// Difference of the mean scene between opposite neighbours, in the steeper direction.
double slope_at(const ArrayXf& map, Index p, Geometry g) {
  const Index x = p % g.width;
  const Index y = p / g.width;
  const float across = map[p + (x + 1 < g.width ? 1 : 0)] - map[p - (x > 0 ? 1 : 0)];
  const float down = map[p + (y + 1 < g.height ? g.width : 0)] - map[p - (y > 0 ? g.width : 0)];
  return std::max(std::abs(across), std::abs(down));
}

// Slope of a pixel's values over the median of its neighbours', in these triplets; unlike a prediction's, it does not
// suffer where the motion is not followed.
double beside(const FieldFrames& frames, const std::vector<Triplet>& triplets, const std::vector<Index>& of, Index p) {
  Line line;
  for (const Index i : of) {
    const auto frame = frames.values.row(triplets[static_cast<std::size_t>(i)].frame);
    line.add(median(neighbours(frame, p, frames.geometry)), frame[p]);
  }
  return line.width() > 0.0 ? line.slope() : 0.0;
}

// Pixels that, in these triplets, do not respond to the scene as their neighbours do, or scatter far more; in both
// cases by more than an edge at rest with a small tracking error explains.
Mask unresponsive_in(const Cells& cells, const FieldFrames& frames, const std::vector<Triplet>& triplets,
                     const std::vector<Index>& of, double floor) {
  const Geometry g = cells.residual.geometry;
  const Index pixels = cells.residual.values.cols();
  ArrayXf scatter = ArrayXf::Zero(pixels);
  ArrayXf follows = ArrayXf::Zero(pixels);  // slope + 0.5; 0: unknown
  ArrayXf varies = ArrayXf::Zero(pixels);   // scatter of the prediction
  ArrayXf level = ArrayXf::Zero(pixels);    // of the mean scene
  std::vector<double> predicted;
  std::vector<double> missed;
  for (Index p = 0; p < pixels; ++p) {
    Line line;
    predicted.clear();
    missed.clear();
    for (const Index i : of) {
      if (cells.residual.valid(i, cells.blocks.of(p)) == 0) continue;
      const double y = frames.values(triplets[static_cast<std::size_t>(i)].frame, p);
      missed.push_back(cells.residual.values(i, p));
      predicted.push_back(y - missed.back());
      line.add(predicted.back(), y);
    }
    if (line.count() < kLeastLooks) continue;
    level[p] = static_cast<float>(line.level(0.0));
    scatter[p] = static_cast<float>(usual_scatter(missed));
    varies[p] = static_cast<float>(usual_scatter(predicted));
    if (varies[p] > kSeenContrast * floor) follows[p] = static_cast<float>(std::max(line.slope(), -0.4) + 0.5);
  }
  Mask unresponsive(static_cast<std::size_t>(pixels), 0);
  for (Index p = 0; p < pixels; ++p) {
    const double edge = kOfEdge * slope_at(level, p, g);
    const bool still = follows[p] > 0.0F && follows[p] < kFollows + 0.5 && around(follows, p, g) > kFollow + 0.5;
    const double usual = around(scatter, p, g);
    const bool noisy =
        usual > 0.0 && scatter[p] > kNoisyScatter * std::max(usual, floor);  // coarse steps may hide noise
    const bool dead = still && varies[p] > edge && beside(frames, triplets, of, p) < kFollows;
    unresponsive[static_cast<std::size_t>(p)] = dead || (noisy && scatter[p] > edge) ? 1 : 0;
  }
  return unresponsive;
}

}  // namespace

void find_unresponsive(const Cells& cells, const FieldFrames& frames, const std::vector<Triplet>& triplets,
                       double floor, Mask& dead) {
  const auto halves = halves_of(cells.triplets());
  const Mask first = unresponsive_in(cells, frames, triplets, halves[0], floor);
  const Mask second = unresponsive_in(cells, frames, triplets, halves[1], floor);
  for (std::size_t p = 0; p < dead.size(); ++p) {
    if (first[p] != 0 && second[p] != 0) dead[p] = 1;
  }
}

void fill_dead(FieldFrames& frames, const Mask& dead) {
  const Geometry g = frames.geometry;
  for (std::size_t p = 0; p < dead.size(); ++p) {
    if (dead[p] == 0) continue;
    std::vector<Index> good;
    visit_around(g, place_of(p, g.width), 1, [&](std::size_t q) {
      if (dead[q] == 0) good.push_back(static_cast<Index>(q));
    });
    if (good.empty()) continue;
    frames.values.col(static_cast<Index>(p)).setZero();
    for (const Index q : good) {
      frames.values.col(static_cast<Index>(p)) += frames.values.col(q) / static_cast<float>(good.size());
    }
  }
}

}  // namespace bolo::diagnose
