#include "tools/lab/bench/naive_admm.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>

#include "src/model/bolometer.hpp"
#include "src/model/haar.hpp"

namespace bolo::tools {
namespace {

using Eigen::MatrixXf;
using Eigen::VectorXf;

// V H^T: the response of the samples to each coefficient.
MatrixXf response(const deblur::Settings& settings) {
  const int bins = 1 << settings.levels;
  const int frames = settings.window - 1;
  const double part_s = settings.period_s * frames / bins;
  Eigen::MatrixXd v = Eigen::MatrixXd::Zero(frames, bins);
  for (int j = 0; j < frames; ++j) {
    const double end_s = (j + 1) * settings.period_s;
    for (int k = 0; (k + 1) * part_s <= end_s + 1e-12; ++k) {
      v(j, k) = -std::expm1(-part_s / settings.tau_s) * std::exp(-(end_s - (k + 1) * part_s) / settings.tau_s);
    }
  }
  return (v * model::haar_matrix(bins).transpose()).cast<float>();
}

}  // namespace

void naive_admm(const deblur::Settings& settings, int iterations, std::span<const void* const> planes, double scale,
                std::size_t pixels, float* out) {
  const MatrixXf z = response(settings);
  const auto frames = static_cast<Eigen::Index>(planes.size()) - 1;
  const double p = -std::expm1(-settings.period_s / settings.tau_s);
  const double bins_a_frame = static_cast<double>(z.cols()) / static_cast<double>(frames);
  const auto rho = static_cast<float>(p * p / bins_a_frame);
  const float limit = static_cast<float>(settings.half_square_lambda()) / rho;
  const MatrixXf inverse = (z.transpose() * z + rho * MatrixXf::Identity(z.cols(), z.cols())).inverse();
  const VectorXf last = model::haar_matrix(static_cast<int>(z.cols())).cast<float>().transpose().row(z.cols() - 1);
  VectorXf data(frames);
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    const auto sample = [&](Eigen::Index slot) {
      return static_cast<double>(static_cast<const std::uint16_t*>(planes[static_cast<std::size_t>(slot)])[pixel]);
    };
    double mean = 0.0;
    for (Eigen::Index slot = 0; slot <= frames; ++slot) mean += sample(slot) / static_cast<double>(frames + 1);
    for (Eigen::Index slot = 1; slot <= frames; ++slot) {
      const double left =
          (sample(0) - mean) * std::exp(-settings.period_s * static_cast<double>(slot) / settings.tau_s);
      data(slot - 1) = static_cast<float>(scale * (sample(slot) - mean - left));
    }
    const VectorXf right = z.transpose() * data;
    VectorXf d = VectorXf::Zero(z.cols());
    VectorXf u = VectorXf::Zero(z.cols());
    VectorXf copy = VectorXf::Zero(z.cols());
    for (int k = 0; k < iterations; ++k) {
      d.noalias() = inverse * (right + rho * (copy - u));
      const VectorXf w = d + u;
      u = w.cwiseMax(-limit).cwiseMin(limit);
      copy = w - u;
    }
    out[pixel] = static_cast<float>(scale * mean) + last.dot(d);
  }
}

}  // namespace bolo::tools
