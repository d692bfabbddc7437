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

class ExactMethod final : public PixelMethod {
 public:
  explicit ExactMethod(const StreamTask& task) : task_(task) {}

  void prepare(const Pattern& pattern) noexcept override {
    deblur::prepare(*plan_, task_.settings, task_.lambda_half(), pattern);
  }

  void run(const PixelRun& run) const noexcept override {
    std::array<double, kMaxSlots> y{};
    const auto samples = static_cast<std::size_t>(plan_->samples);
    for (std::size_t pixel = run.begin; pixel < run.end; ++pixel) {
      for (std::size_t i = 0; i < samples; ++i) y[i] = value_at(run.planes[plan_->slot[i]], run.input, pixel);
      store(deblur::solve(*plan_, {y.data(), samples}), pixel, run);
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
