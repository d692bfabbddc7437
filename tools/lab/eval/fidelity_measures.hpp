// How far an estimate is from the truth.
#pragma once

#include <span>

#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {

struct Measures {
  double rmse_k = 0.0;
  double psnr_db = 0.0;
  double ssim = 0.0;
  double edge_width_px = 0.0;  // NaN when the truth has no clear edge, or the estimate never crosses 10 and 90 %
  double edge_rmse_k = 0.0;
  double shifted_rmse_k = 0.0;
  double flat_noise_k = 0.0;
};

// Root mean square difference over all planes, K. Both have the same planes. Thread: any.
double rmse(const Planes& estimate, const Planes& truth);

// 20 log10(range / rmse), dB. Infinite for rmse 0. Thread: any.
double psnr(double rmse, double range);

// Mean structural similarity (Wang, Bovik, Sheikh and Simoncelli, IEEE TIP 13(4), 2004): Gaussian window 11x11, sigma
// 1.5, K1 0.01, K2 0.03, windows that lie inside the image only. NaN when the image is smaller than a window.
// Thread: any.
double ssim(std::span<const float> a, std::span<const float> b, Geometry geometry, double range);

// 10-90 % rise, px, of the median profile across the truth's strongest vertical edges that have no other edge within 16
// columns: each edge's profile is scaled so that the truth's levels on either side are 0 and 1. NaN when there is no
// such edge or crossing. Thread: any.
double edge_width(const Planes& estimate, const Planes& truth, Geometry geometry);

// RMSE where the truth's gradient magnitude (central differences) is in the upper 5 % of its plane. Thread: any.
double edge_rmse(const Planes& estimate, const Planes& truth, Geometry geometry);

// RMSE where each plane may be shifted against the truth by what makes its error least, at most 24 px along x and 8
// along y and to fractions of a pixel: what is left is not lag. Over the pixels that both see. Thread: any.
double shifted_rmse(const Planes& estimate, const Planes& truth, Geometry geometry);

// Root mean square of the error about its mean in each of the 10 % flattest tiles of 16x16 pixels of the truth: noise,
// whatever the lag. NaN when the picture is smaller than a tile. Thread: any.
double flat_noise(const Planes& estimate, const Planes& truth, Geometry geometry);

// All of them, range kContrastK; ssim is the mean over the planes, of kelvin above the coldest true pixel. Thread: any.
Measures measure(const Planes& estimate, const Planes& truth, Geometry geometry);

}  // namespace bolo::tools::fidelity
