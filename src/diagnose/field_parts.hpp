// What the residual of a followed scene is made of. Every part is found twice, from two halves of the data that have
// nothing in common: what both show is there, what only one shows is chance, or the scene.
#pragma once

#include <array>
#include <vector>

#include "src/diagnose/field_predict.hpp"
#include "src/diagnose/report.hpp"
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {

// Fixed ones.
struct Offsets {
  Measured pixel;   // of single pixels, columns apart
  Measured column;  // of whole columns
};

struct FieldParts {
  double noise = 0.0;     // of one value where the scene is flat, sigma
  double moving = 0.0;    // share of the blocks whose motion is their own: left out
  bool followed = false;  // the scene, not a pattern or something before it
  std::size_t cells = 0;  // blocks of frames that were predicted
  double gap_before = 1.0;
  double gap_after = 1.0;
  Offsets offset;
  Measured gain;               // of single pixels, where the scene changes enough before them
  double gain_likeness = 0.0;  // correlation of these with their neighbours
  Offsets beside_gain;         // `offset` without what these gains make of the scene
  std::vector<char> dead;
  std::vector<std::size_t> lost;  // frames before which others are missing
  std::vector<Map> scene;         // Report::scene, without units
};

// Of a recording whose scene moves. `dead`: of each pixel, as known before; those that do not follow the scene are
// added. `frames`: dead pixels are filled.
FieldParts take_field_apart(FieldFrames& frames, const std::vector<Sight>& sights, std::vector<char> dead);

}  // namespace bolo::diagnose
