// Weighted residual and derivatives of one recording on the fit's pixels.
#pragma once

#include <vector>

#include "session.hpp"

namespace bolo::diagnose {

struct Columns {
  Series residual;
  std::vector<Series> column;             // empty where the coordinate has no influence
  std::vector<double> shift;              // moving bars: the residual's share of each frame's shift, px
  std::vector<std::vector<double>> turn;  // the same of each column
};

}  // namespace bolo::diagnose
