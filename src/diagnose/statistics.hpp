// Small statistics that several judgements share.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace bolo::diagnose {

// The upper median; 0 of nothing.
double median(std::vector<double> values);

// A straight line through points that come one by one, by least squares.
class Line {
 public:
  void add(double x, double y);
  double count() const { return n_; }
  // n^2 times the variance of x: without it there is no slope.
  double width() const { return n_ * sxx_ - sx_ * sx_; }
  double slope() const { return (n_ * sxy_ - sx_ * sy_) / width(); }
  double at(double x) const { return (sy_ - slope() * (sx_ - n_ * x)) / n_; }
  // Squared scatter of y about its mean, and of x and y together.
  double scatter_y() const { return syy_ - sy_ * sy_ / n_; }
  double scatter_x() const { return sxx_ - sx_ * sx_ / n_; }
  double scatter_xy() const { return sxy_ - sx_ * sy_ / n_; }

 private:
  double n_ = 0.0;
  double sx_ = 0.0;
  double sy_ = 0.0;
  double sxx_ = 0.0;
  double sxy_ = 0.0;
  double syy_ = 0.0;
};

// Power in each bin from 0 to half the sampling rate through Hann's window; white noise has its variance in every bin.
std::vector<double> periodogram(const Eigen::ArrayXd& x);

}  // namespace bolo::diagnose
