// Normal equations of a linear model, training and held-out cells apart, and their solution within bounds.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "session.hpp"

namespace bolo::diagnose {

// Of one block of frames: products of all columns, with the residual as the last one.
struct Group {
  Eigen::MatrixXd train;
  Eigen::MatrixXd test;
};

// One group for each kCellFrames frames. An empty column is one without influence; `pixels` are those of the columns.
std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels);

// The solution within bounds: what would go beyond one stays there, and the others are solved for once more.
Eigen::VectorXd solve_within(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right, const Eigen::VectorXd& low,
                             const Eigen::VectorXd& high);

Eigen::MatrixXd inverse(const Eigen::MatrixXd& normal);

}  // namespace bolo::diagnose
