// Positions of values along an axis, and its ticks.
#pragma once

#include <string>
#include <vector>

#include "src/report/plot.hpp"

namespace bolo::plot {

struct Tick {
  double at = 0.0;
  std::string text;
};

class Scale {
 public:
  // Around the finite values of `values` (on a logarithmic axis: those above zero), where the axis leaves its ends to
  // them; `tight`: without a margin.
  Scale(const Axis& axis, const std::vector<double>& values, bool tight);

  // 0 at the low end, 1 at the high end. Not a number for what has no place.
  double place(double value) const noexcept;
  double low() const noexcept { return low_; }
  double high() const noexcept { return high_; }
  bool logarithmic() const noexcept { return logarithmic_; }
  // About so many, at round values; for categories each one.
  std::vector<Tick> ticks(int wanted) const;

 private:
  double low_ = 0.0;
  double high_ = 1.0;
  bool logarithmic_ = false;
  std::vector<std::string> categories_;
};

}  // namespace bolo::plot
