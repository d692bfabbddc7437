#include "src/deblur/settings.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <sstream>

namespace bolo::deblur {
namespace {

constexpr double kLeastTau_s = 1e-6;   // far below any pixel's; keeps period / tau finite
constexpr double kLittleLeft = 0.05;   // of a frame that remains in the next one
constexpr double kNothingLeft = 1e-4;  // below it the remainder is not stated more exactly
constexpr float kLargestValue = 1e7F;  // far above any temperature and count
constexpr int kModelLookahead = 15;    // the models cover 17 frames

// Collects one sentence for every value out of range.
class Complaints {
 public:
  template <typename T>
  void unless(bool good, std::string_view item, T value, std::string_view range) {
    if (good) return;
    if (!empty_) text_ << "; ";
    text_ << item << " is " << value << ", must be " << range;
    empty_ = false;
  }

  Status status() const {
    if (empty_) return {};
    return bad_input("deblur settings: " + text_.str());
  }

 private:
  std::ostringstream text_;
  bool empty_ = true;
};

bool between(double value, double low, double high) { return value >= low && value <= high; }  // false for NaN

constexpr double kKelvinPerCount = 0.01;
constexpr double kLargestAutomatic = 0.5;  // K

}  // namespace

std::string_view name(Method method) {
  for (const auto& [text, value] : kMethodNames) {
    if (value == method) return text;
  }
  return "unknown";
}

Result<Method> method_from_name(std::string_view text) {
  for (const auto& [known, value] : kMethodNames) {
    if (known == text) return value;
  }
  return bad_input("solver \"" + std::string(text) + "\" is unknown; use admm, dual, exact, inverse, mmae or motion");
}

Status validate(const Settings& settings) {
  Complaints complaints;
  const int rows = std::clamp(settings.window, 0, 100) - 1;  // may be any number here; it is refused below
  complaints.unless(settings.tau_s >= kLeastTau_s && settings.tau_s < 1.0, "tau_s", settings.tau_s,
                    "at least 0.000001 and below 1 s");
  complaints.unless(between(settings.period_s, 1e-5, 10.0), "period_s", settings.period_s, "0.00001 to 10 s");
  complaints.unless(rows >= 2 && rows <= 64 && std::has_single_bit(static_cast<unsigned>(rows)), "window",
                    settings.window, "3, 5, 9, 17, 33 or 65 frames (a power of two and one)");
  complaints.unless(settings.levels >= 1 && settings.levels <= 10, "levels", settings.levels, "1 to 10");
  complaints.unless(settings.kappa > 0.0 && std::isfinite(settings.kappa), "kappa", settings.kappa, "above 0");
  complaints.unless(settings.lambda >= 0.0 && std::isfinite(settings.lambda), "lambda", settings.lambda, "0 or more");
  complaints.unless(settings.noise_k >= 0.0 && std::isfinite(settings.noise_k), "noise_k", settings.noise_k,
                    "0 (measured) or more");
  complaints.unless(settings.iterations >= 0 && settings.iterations <= 1000, "iterations", settings.iterations,
                    "0 (automatic) to 1000");
  complaints.unless(settings.lookahead >= 0 && settings.lookahead < rows, "lookahead", settings.lookahead,
                    "0 to window - 2 frames");
  // The models account for the motion between frames themselves.
  const bool far_apart = settings.period_s > kLongestRatioToLookAhead * settings.tau_s;
  complaints.unless(!far_apart || settings.lookahead == 0 || settings.method == Method::kMmae, "lookahead",
                    settings.lookahead, "0 where frames are more than 2 tau apart: it would show two frames in one");
  const bool models = settings.auto_lambda || settings.method == Method::kMmae;
  complaints.unless(!models || settings.lookahead <= kModelLookahead, "lookahead", settings.lookahead,
                    "at most 15 frames with mmae or lambda auto");
  const bool motion = settings.method == Method::kMotion;
  complaints.unless(!motion || settings.lookahead <= 1, "lookahead", settings.lookahead, "0 or 1 with motion");
  complaints.unless(!motion || settings.window >= 17, "window", settings.window, "17 frames or more with motion");
  return complaints.status();
}

Status check_gyro(const Settings& settings) {
  if (settings.method != Method::kMotion) return bad_input("a gyro is of use to the solver motion alone");
  if (settings.gyro_setup.focal_px > 0.0) return {};
  return bad_input("a gyro needs lens.focal_px in the camera profile");
}

std::string weak_inertia_warning(const Settings& settings) {
  const double left = std::exp(-settings.period_s / settings.tau_s);
  if (left > kLittleLeft) return {};
  std::ostringstream text;
  text.precision(4);  // 111 and 1000, not 1.1e+02
  text << "frames come every " << std::round(settings.period_s * 1e4) / 10.0 << " ms, ";
  text.precision(2);
  text << settings.period_s / settings.tau_s << " times tau: " << (left < kNothingLeft ? "less than " : "only ")
       << 100.0 * std::max(left, kNothingLeft) << " % of a frame is left in the next, there is next to nothing to undo";
  return text.str();
}

void StreamTask::load_row(const void* plane, int y, float* to) const noexcept {
  const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(input.geometry.width);
  if (input.type == PixelType::kUint16) {
    const auto* from = static_cast<const std::uint16_t*>(plane) + row;
    for (int x = 0; x < input.geometry.width; ++x) to[x] = static_cast<float>(from[x]);
    return;
  }
  const auto* from = static_cast<const float*>(plane) + row;
  float last = 0.0F;
  for (int x = 0; x < input.geometry.width; ++x) {
    last = std::abs(from[x]) < kLargestValue ? from[x] : last;
    to[x] = last;
  }
}

double StreamTask::kelvin_per_value() const {
  return input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : kKelvinPerCount;
}

double StreamTask::in_kelvin(double value) const {
  return input.scale.unit == Unit::kKelvin ? value * std::abs(input.scale.scale) : value;
}

double StreamTask::lambda_half() const {
  const double unit = input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : 1.0;
  return settings.half_square_lambda() / unit;
}

double lambda_to_tune(const StreamTask& task) {
  return task.settings.auto_lambda ? kLargestAutomatic : task.lambda_half() * task.kelvin_per_value();
}

}  // namespace bolo::deblur
