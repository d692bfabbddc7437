// Is there more in a map of pixels than pixels that differ? What changes smoothly from row to row has another cause.
#pragma once

#include <Eigen/Core>

#include "session.hpp"

namespace bolo::diagnose {

// By how many standard errors the means of rows follow a parabola over the rows. Columns may differ; pixels of 0 do not
// count.
double row_trend_z(const Session& session, const Eigen::VectorXf& map);

// Above it the rows' means are no accident.
inline constexpr double kClearTrend = 4.5;

}  // namespace bolo::diagnose
