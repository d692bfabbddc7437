#include "normal_equations.hpp"

#include <algorithm>
#include <array>

#include <Eigen/Dense>

#include "score.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kPriorFloor = 1e-12;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Adds one group's frames to augmented normal matrices: train and test.
void add_group(const Session& session, const Series& residual, const std::vector<Series>& columns,
               std::span<const int> pixels, Index from, Index to, MatrixXd& train, MatrixXd& test) {
  const auto unknowns = static_cast<Index>(columns.size());
  std::vector<Index> present;
  for (Index j = 0; j < unknowns; ++j) {
    if (columns[static_cast<std::size_t>(j)].size() > 0) present.push_back(j);
  }
  const auto some = static_cast<Index>(present.size());
  std::array<std::vector<Index>, 2> chosen;  // pixels of the group's train and test cells
  for (std::size_t p = 0; p < pixels.size(); ++p) {
    chosen[held_out(session, static_cast<std::size_t>(from), pixels[p]) ? 1 : 0].push_back(static_cast<Index>(p));
  }
  for (int side = 0; side < 2; ++side) {
    const auto& cells = chosen[static_cast<std::size_t>(side)];
    const auto count = static_cast<Index>(cells.size()) * (to - from);
    Eigen::MatrixXf x(count, some + 1);
    for (Index j = 0; j <= some; ++j) {
      const Series& source =
          j == some ? residual : columns[static_cast<std::size_t>(present[static_cast<std::size_t>(j)])];
      Index at = 0;
      for (Index k = from; k < to; ++k) {
        for (const Index p : cells) x(at++, j) = source(k, p);
      }
    }
    const MatrixXd product = (x.transpose() * x).cast<double>();
    MatrixXd& sum = side == 0 ? train : test;
    const auto place = [&](Index j) { return j == some ? unknowns : present[static_cast<std::size_t>(j)]; };
    for (Index a = 0; a <= some; ++a) {
      for (Index b = 0; b <= some; ++b) sum(place(a), place(b)) += product(a, b);
    }
  }
}

// Scaled to a unit diagonal, with a whisper of a ridge: columns that nothing sees come out as zero.
MatrixXd solve(const MatrixXd& normal, const MatrixXd& right) {
  const VectorXd scale = normal.diagonal().cwiseMax(kPriorFloor).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  scaled.diagonal().array() += 1e-13;
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * right);
}

}  // namespace

std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels) {
  std::vector<Group> groups;
  const auto size = static_cast<Index>(columns.size()) + 1;
  for (Index from = 0; from < residual.rows(); from += kCellFrames) {
    const Index to = std::min<Index>(residual.rows(), from + kCellFrames);
    Group& group = groups.emplace_back(Group{MatrixXd::Zero(size, size), MatrixXd::Zero(size, size)});
    add_group(session, residual, columns, pixels, from, to, group.train, group.test);
  }
  return groups;
}

VectorXd solve_within(const MatrixXd& normal, const VectorXd& right, const VectorXd& low, const VectorXd& high) {
  const Index n = right.size();
  std::vector<char> held(static_cast<std::size_t>(n), 0);
  VectorXd x = VectorXd::Zero(n);
  for (int round = 0; round < 6; ++round) {
    std::vector<Index> free;
    for (Index j = 0; j < n; ++j) {
      if (held[static_cast<std::size_t>(j)] == 0) free.push_back(j);
    }
    const auto count = static_cast<Index>(free.size());
    MatrixXd a(count, count);
    VectorXd b(count);
    for (Index r = 0; r < count; ++r) {
      const Index i = free[static_cast<std::size_t>(r)];
      b[r] = right[i];
      for (Index j = 0; j < n; ++j) {
        if (held[static_cast<std::size_t>(j)] != 0) b[r] -= normal(i, j) * x[j];
      }
      for (Index c = 0; c < count; ++c) a(r, c) = normal(i, free[static_cast<std::size_t>(c)]);
    }
    const VectorXd solved = solve(a, b);
    bool again = false;
    for (Index r = 0; r < count; ++r) {
      const Index j = free[static_cast<std::size_t>(r)];
      x[j] = std::clamp(solved[r], low[j], high[j]);
      if (x[j] == solved[r]) continue;
      held[static_cast<std::size_t>(j)] = 1;
      again = true;
    }
    if (!again) break;
  }
  return x;
}

MatrixXd inverse(const MatrixXd& normal) { return solve(normal, MatrixXd::Identity(normal.rows(), normal.cols())); }

}  // namespace bolo::diagnose
