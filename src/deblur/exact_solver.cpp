// The reference: one pixel after another, double precision, to convergence.
#include <algorithm>
#include <cmath>

#include "src/deblur/exact_plan.hpp"
#include "src/deblur/solvers.hpp"

namespace bolo::deblur {
namespace {

double value_at(const void* plane, PixelType type, std::size_t pixel) {
  return type == PixelType::kUint16 ? static_cast<double>(static_cast<const std::uint16_t*>(plane)[pixel])
                                    : static_cast<double>(static_cast<const float*>(plane)[pixel]);
}

class ExactSolver final : public Solver {
 public:
  explicit ExactSolver(const StreamTask& task) : task_(task) {}

  void prepare(const WindowView& window) noexcept override {
    const Pattern pattern = pattern_of(window);
    if (pattern == pattern_) return;
    pattern_ = pattern;
    deblur::prepare(*plan_, task_.settings, task_.lambda_half(), pattern);
  }

  void solve(const WindowView& window, RowRange rows, void* out) const noexcept override {
    const auto width = static_cast<std::size_t>(task_.input.geometry.width);
    const auto end = static_cast<std::size_t>(rows.end) * width;
    std::array<double, kMaxSlots> y{};
    for (auto pixel = static_cast<std::size_t>(rows.begin) * width; pixel < end; ++pixel) {
      const auto samples = static_cast<std::size_t>(plan_->samples);
      for (std::size_t i = 0; i < samples; ++i) {
        const void* plane = window.planes[static_cast<std::size_t>(plan_->slot[i])];
        y[i] = value_at(plane, task_.input.type, pixel);
      }
      store(deblur::solve(*plan_, {y.data(), samples}), pixel, out);
    }
  }

  int iterations() const noexcept override { return 0; }
  std::string_view isa() const noexcept override { return "scalar"; }

 private:
  void store(double value, std::size_t pixel, void* out) const noexcept {
    if (task_.output == PixelType::kFloat32) {
      static_cast<float*>(out)[pixel] = static_cast<float>(task_.input.scale.to_physical(value));
    } else {
      const double number = std::isnan(value) ? 0.0 : std::clamp(value, 0.0, 65535.0);
      static_cast<std::uint16_t*>(out)[pixel] = static_cast<std::uint16_t>(std::lrint(number));
    }
  }

  StreamTask task_;
  Pattern pattern_;
  std::unique_ptr<ExactPlan> plan_ = std::make_unique<ExactPlan>();  // some 400 kB
};

}  // namespace

std::unique_ptr<Solver> make_exact_solver(const StreamTask& task) { return std::make_unique<ExactSolver>(task); }

}  // namespace bolo::deblur
