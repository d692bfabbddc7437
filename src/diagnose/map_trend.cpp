#include "map_trend.hpp"

#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "effect.hpp"

namespace bolo::diagnose {

double row_trend_z(const Session& session, const Eigen::VectorXf& map) {
  const MapSpread spread = spread_of(session, map);
  const std::size_t width = session.grid.columns.size();
  const std::size_t height = session.grid.rows.size();
  if (spread.pixel <= 0.0 || height < 6) return 0.0;
  std::vector<double> sum(height, 0.0);
  std::vector<double> count(height, 0.0);
  for (Eigen::Index p = 0; p < map.size(); ++p) {
    if (map[p] == 0.0F) continue;
    sum[static_cast<std::size_t>(p) / width] += static_cast<double>(map[p]);
    count[static_cast<std::size_t>(p) / width] += 1.0;
  }
  // Each row's mean in units of its standard error, and the same of 1, s and s^2.
  Eigen::MatrixXd basis = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(height), 3);
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(basis.rows());
  for (std::size_t r = 0; r < height; ++r) {
    if (count[r] < 1.0) continue;
    const double weight = std::sqrt(count[r]) / spread.pixel;
    const double s = 2.0 * static_cast<double>(r) / static_cast<double>(height - 1) - 1.0;
    const auto row = static_cast<Eigen::Index>(r);
    basis.row(row) << weight, weight * s, weight * s * s;
    mean[row] = weight * sum[r] / count[r];
  }
  const auto explained = [&mean](const Eigen::MatrixXd& by) {
    return (by * by.colPivHouseholderQr().solve(mean)).squaredNorm();
  };
  return std::sqrt(std::max(0.0, explained(basis) - explained(basis.leftCols(1))));
}

}  // namespace bolo::diagnose
