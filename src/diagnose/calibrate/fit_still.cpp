// Noise, fixed pattern and dead pixels from a still field.
#include <algorithm>
#include <cmath>

#include "src/diagnose/calibrate.hpp"
#include "statistics.hpp"

namespace bolo::diagnose {
namespace {

constexpr std::size_t kFewestFrames = 16;
constexpr double kNoisy = 4.0;    // times the usual noise
constexpr double kFrozen = 0.1;   // of the usual noise
constexpr double kStill = 3.0;    // what a frame's mean may scatter by, in units of a pixel's noise
constexpr double kSlow = 1.5;     // what a pixel's slow changes may come to, in units of its noise
constexpr double kUneven = 3.0;   // times the usual noise: more than one pixel in twenty has it where a scene moves
constexpr double kFarOff = 12.0;  // scatters of the fixed pattern: a pixel that says something else

// Sums over time; `rough` are those of differences between neighbouring frames, less the frame's own.
struct Moments {
  std::vector<float> base;
  std::vector<double> y, yy, rough;
  std::vector<double> frame_mean;  // less that of the first
};

Result<Moments> moments_of(const FrameSeries& frames, const Progress& progress) {
  const std::size_t pixels = frames.geometry.pixels();
  Moments m;
  m.y.assign(pixels, 0.0);
  m.yy = m.y;
  m.rough = m.y;
  std::vector<float> frame(pixels);
  std::vector<float> last(pixels);
  std::vector<double> change(pixels);
  for (std::size_t k = 0; k < frames.t_s.size(); ++k) {
    if (!progress("still field", static_cast<double>(k) / static_cast<double>(frames.t_s.size()))) {
      return failed("interrupted");
    }
    if (Status read = frames.read(k, frame); !read) return tl::unexpected(read.error());
    if (k == 0) m.base = last = frame;
    double sum = 0.0;
    for (std::size_t p = 0; p < pixels; ++p) {
      if (!std::isfinite(frame[p])) return bad_input(frames.name + ": /frames has values that are no numbers");
      const double y = static_cast<double>(frame[p]) - static_cast<double>(m.base[p]);
      m.y[p] += y;
      m.yy[p] += y * y;
      change[p] = static_cast<double>(frame[p]) - static_cast<double>(last[p]);
      sum += y;
    }
    const double shared = median(change);
    for (std::size_t p = 0; p < pixels; ++p) m.rough[p] += (change[p] - shared) * (change[p] - shared);
    m.frame_mean.push_back(sum / static_cast<double>(pixels));
    std::swap(last, frame);
  }
  return m;
}

double quantile(std::vector<double> values, double share) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Whether the camera saw something move: the frames' mean, the pixels slowly, or some pixels more than others.
// Variances of each pixel, between its neighbouring frames (`own`), and of the frames' means.
bool moves(const std::vector<double>& variance, const std::vector<double>& own, double of_means, double least) {
  const double usual = std::max(median(own), least * least);
  const double slow = median(variance) - usual - of_means;
  return of_means > kStill * kStill * usual || slow > kSlow * kSlow * usual ||
         quantile(own, 0.95) > kUneven * kUneven * usual;
}

double rms_over(const std::vector<double>& variances, const std::vector<DeadPixel>& dead) {
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t p = 0; p < variances.size(); ++p) {
    if (dead[p] != DeadPixel::kGood) continue;
    sum += variances[p];
    count += 1.0;
  }
  return count > 0.0 ? std::sqrt(sum / count) : 0.0;
}

}  // namespace

Result<StillFit> fit_still(const FrameSeries& frames, const Progress& progress) {
  if (frames.t_s.size() < kFewestFrames) {
    return bad_input(frames.name + ": has " + std::to_string(frames.t_s.size()) + " frames; at least " +
                     std::to_string(kFewestFrames) + " are needed");
  }
  const auto moments = moments_of(frames, progress);
  if (!moments) return tl::unexpected(moments.error());
  const auto n = static_cast<double>(frames.t_s.size());
  const std::size_t pixels = frames.geometry.pixels();
  std::vector<double> variance(pixels);
  std::vector<double> own(pixels);
  std::vector<double> level(pixels);
  std::vector<double> noise(pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    const double mean = moments->y[p] / n;
    variance[p] = std::max(0.0, moments->yy[p] / n - mean * mean) * n / (n - 1.0);
    own[p] = moments->rough[p] / (2.0 * (n - 1.0));
    level[p] = static_cast<double>(moments->base[p]) + mean;
    noise[p] = std::sqrt(variance[p]);
  }
  StillFit fit;
  const double usual = median(noise);
  const double centre = median(level);
  std::vector<double> away(pixels);
  for (std::size_t p = 0; p < pixels; ++p) away[p] = std::abs(level[p] - centre);
  const double scatter = median(away) / 0.6745 + usual;
  fit.dead.assign(pixels, DeadPixel::kGood);
  for (std::size_t p = 0; p < pixels; ++p) {
    if (noise[p] > kNoisy * usual && usual > 0.0) fit.dead[p] = DeadPixel::kNoisy;
    if (away[p] > kFarOff * scatter && usual > 0.0) fit.dead[p] = DeadPixel::kSilent;
    if (noise[p] < kFrozen * usual) fit.dead[p] = DeadPixel::kFrozen;
  }
  fit.noise_k = rms_over(variance, fit.dead);
  fit.pixel_noise_k = rms_over(own, fit.dead);
  double drift = 0.0;
  for (const double v : moments->frame_mean) drift += v / n;
  double scatter2 = 0.0;
  for (const double v : moments->frame_mean) scatter2 += (v - drift) * (v - drift) / n;
  if (moves(variance, own, scatter2, 0.5 * frames.step)) {
    return bad_input(frames.name +
                     ": is no still field: it changes by more than noise does; give a closed shutter or a flat black "
                     "body");
  }

  double mean = 0.0;
  double good = 0.0;
  for (std::size_t p = 0; p < pixels; ++p) {
    if (fit.dead[p] != DeadPixel::kGood) continue;
    mean += level[p];
    good += 1.0;
  }
  mean /= std::max(1.0, good);
  double pattern2 = 0.0;
  for (std::size_t p = 0; p < pixels; ++p) {
    if (fit.dead[p] == DeadPixel::kGood) pattern2 += (level[p] - mean) * (level[p] - mean) / std::max(1.0, good - 1.0);
  }
  const double error2 = std::pow(fit.pixel_noise_k, 2) / n;
  const double own2 = std::max(0.0, pattern2 - error2);
  fit.offset_rms_k = std::sqrt(own2);
  // A pattern is there when the levels scatter by more than chance lets them.
  if (own2 > 4.0 * error2 * std::sqrt(2.0 / std::max(1.0, good)) + 1e-12) {
    const double reliability = own2 / (own2 + error2);
    fit.offset_k.assign(pixels, 0.0F);
    for (std::size_t p = 0; p < pixels; ++p) {
      if (fit.dead[p] == DeadPixel::kGood) fit.offset_k[p] = static_cast<float>(-reliability * (level[p] - mean));
    }
  }
  return fit;
}

}  // namespace bolo::diagnose
