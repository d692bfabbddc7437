// The reference: one pixel after another, double precision, to convergence.
#include <algorithm>
#include <cmath>

#include "src/deblur/exact_plan.hpp"
#include "src/deblur/method.hpp"

namespace bolo::deblur {
namespace {

double value_at(const void* plane, PixelType type, std::size_t pixel) {
  return type == PixelType::kUint16 ? static_cast<double>(static_cast<const std::uint16_t*>(plane)[pixel])
                                    : static_cast<double>(static_cast<const float*>(plane)[pixel]);
}

double subtract_mean(std::span<double> y) {
  double mean = 0.0;
  for (const double value : y) mean += value / static_cast<double>(y.size());
  for (double& value : y) value -= mean;
  return mean;
}

class ExactMethod final : public PixelMethod {
 public:
  explicit ExactMethod(const StreamTask& task) : task_(task) {}

  void prepare(const Pattern& pattern) noexcept override {
    deblur::prepare(*plan_, task_.settings, task_.lambda_half(), pattern);
  }

  void run(const PixelRun& run) const noexcept override {
    std::array<double, kMaxSlots> y{};
    const auto samples = static_cast<std::size_t>(plan_->samples);
    const Coefficients weights = publish_weights(*plan_, run.published);
    Coefficients d;
    for (std::size_t pixel = run.begin; pixel < run.end; ++pixel) {
      for (std::size_t i = 0; i < samples; ++i) y[i] = value_at(run.planes[plan_->slot[i]], run.input, pixel);
      const double mean = subtract_mean({y.data(), samples});
      double estimate = mean;
      if (std::isfinite(mean)) {
        const double lambda = run.lambda == nullptr ? plan_->lambda : static_cast<double>(run.lambda[pixel]);
        deblur::solve(*plan_, {y.data(), samples}, lambda, d);
        estimate += weights.dot(d);
      }
      store(estimate, pixel, run);
    }
  }

  int iterations() const noexcept override { return 0; }
  std::string_view isa() const noexcept override { return "scalar"; }

 private:
  void store(double value, std::size_t pixel, const PixelRun& run) const noexcept {
    if (run.output == PixelType::kFloat32) {
      static_cast<float*>(run.out)[pixel] = static_cast<float>(value * run.scale + run.offset);
    } else {
      const double number = std::isnan(value) ? 0.0 : std::clamp(value, 0.0, 65535.0);
      static_cast<std::uint16_t*>(run.out)[pixel] = static_cast<std::uint16_t>(std::lrint(number));
    }
  }

  StreamTask task_;
  std::unique_ptr<ExactPlan> plan_ = std::make_unique<ExactPlan>();  // some 400 kB
};

}  // namespace

std::unique_ptr<PixelMethod> make_exact(const StreamTask& task) { return std::make_unique<ExactMethod>(task); }

}  // namespace bolo::deblur
